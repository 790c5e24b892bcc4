"""The light of a scene, as factors of its colours."""

from typing import NamedTuple, Self

_RED_OF_LAMPS = 0.12
_BLUE_OF_LAMPS = 0.3
"""At a warmth of 1 red is so much stronger, and blue so much weaker."""


class Light(NamedTuple):
    """How bright a scene is and in which colour it is lit; factors, 1 is the scene as it was made."""

    red: float = 1.0
    green: float = 1.0
    blue: float = 1.0

    @classmethod
    def of(cls, level: float, warmth: float) -> Self:
        """Return the light of a brightness (1 is plain) and a warmth from -1 (daylight) to 1 (lamps)."""
        return cls(level * (1 + _RED_OF_LAMPS * warmth), level, level * (1 - _BLUE_OF_LAMPS * warmth))


PLAIN_LIGHT = Light()
