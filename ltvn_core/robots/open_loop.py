"""Robots that obey no command, because they show what was recorded: how one says so. Drives nothing."""

from ltvn_core.errors import OptionError


def open_loop_word(robot: object) -> str:
    """Return in a sentence why a robot obeys no command; empty where it does.

    A robot of one's own may offer it as an attribute `open_loop`.
    """
    return str(getattr(robot, "open_loop", ""))


def require_drivable(robot: object) -> None:
    """Raise OptionError where a robot obeys no command: nobody learns anything from driving it."""
    if word := open_loop_word(robot):
        raise OptionError(word)
