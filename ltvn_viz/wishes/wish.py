"""The form of a row in the table of wishes: who may ask for what, when, with which value, by which words and keys."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec import Meta

from ltvn_viz.wishes.modes import Mode, refusal

MAX_WHOLE = 2**53 - 1
"""Largest integer that JavaScript represents exactly, as it does all smaller ones."""
MAX_TEXT = 500
"""Maximum number of characters of a name or a question."""
FARTHEST_M = 10_000.0

Whole: TypeAlias = Annotated[int, Meta(ge=0, le=MAX_WHOLE)]
Switch: TypeAlias = Annotated[int, Meta(ge=0, le=1)]
"""1 for on, 0 for off."""
Text: TypeAlias = Annotated[str, Meta(max_length=MAX_TEXT)]
Edge: TypeAlias = tuple[Whole, Whole]
"""Source and target."""
_Metres: TypeAlias = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Place: TypeAlias = tuple[_Metres, _Metres]
"""A position (x, y) in metres."""
Value: TypeAlias = int | str | tuple[float, float] | None
"""Value that comes with a wish."""


class Audience(Enum):
    """Pages that may use a wish."""

    DRIVER = auto()
    """The page with the seat, because all pages see the effect."""
    EVERYBODY = auto()
    """Any page; the driver's seat or the page itself performs it."""


class Need(Enum):
    """What a wish needs besides its mode; the value says that it is missing."""

    NO_RECORDING = "a recording is under way"
    RECORDING = "no recording is under way"
    REBUILD = "the map was not rebuilt"
    FREE_MAKER = "another recording is being made"
    PLAYED_DRIVE = "the robot is no recorded drive"
    OBEDIENT_ROBOT = "a recorded drive obeys no command"
    WORLD = "only a simulated world can be changed"
    CHANGE = "nothing was changed by hand"
    NO_STORY = "the story is under way"
    STORY = "no story can be played here"
    FLOOR_PLAN = "there is no floor plan"


@dataclass(frozen=True, slots=True)
class Wish:
    """One row of the table."""

    name: str
    """Name between page and server."""
    modes: frozenset[Mode]
    """Modes in which the wish is legal."""
    label: str
    """Text of the button; empty if there is no button."""
    help: str
    """Effect of the action; it begins with a small letter, because it follows the name of a key."""
    key: str = ""
    """KeyboardEvent.code of the browser: the position on the keyboard, thus independent of the layout."""
    takes: Any = None
    """Type of the value that a page sends, as msgspec checks it."""
    audience: Audience = Audience.DRIVER
    needs: tuple[Need, ...] = ()
    does: str = ""
    """Function that does it: module:function of the session, called with the state, or part.method of the state.

    It gets the value, if the wish has one, and may return a command that follows. Found by name, because the page is
    served before the session is loaded; empty if the page or its seat does it.
    """
    given: Value = None
    """Value for the function in place of one from the page."""

    @property
    def words(self) -> str:
        """Name of the wish in a message."""
        return self.label or self.help

    def refusal(self, mode: Mode) -> str | None:
        """Return why the wish is illegal in a mode, and what makes it possible; None if it is legal."""
        return refusal(self.words, self.modes, mode)

    def value_of(self, sent: object) -> Value:
        """Return the value that was sent, checked. Raises ValueError if it is of another type, or too large."""
        return msgspec.convert(sent, self.takes)

    @property
    def is_listed(self) -> bool:
        """Tell whether the palette can list the wish without a value."""
        return self.audience is Audience.DRIVER and fits(None, self.takes)


def fits(value: object, takes: Any) -> bool:
    """Tell whether a value is of a type that a wish takes."""
    try:
        msgspec.convert(value, takes)
    except ValueError:
        return False
    return True
