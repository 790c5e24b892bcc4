"""How properties are tested: as often as ever, but never against the clock of a busy machine."""

from hypothesis import settings

settings.register_profile("without a clock", deadline=None)
settings.load_profile("without a clock")
