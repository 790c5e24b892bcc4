"""An answer of the debugger as data: blocks of text, tables, charts and images, in the order in which they are read.

Owns what an answer may consist of. Questions make answers; the page draws them as HTML, the command line prints them as
text or JSON (`ltvn_core.analysis.answer_text`), and none of them knows the others.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.palette import Rgb8
from ltvn_core.types import Observation, Waypoint


class Strong(NamedTuple):
    """Words that stand out."""

    text: str


class Term(NamedTuple):
    """A word of the glossary, or a symbol such as p, that explains itself."""

    word: str
    shown: str = ""
    """Text shown instead; empty for the word itself."""


class Code(NamedTuple):
    """A command or a path, to be copied letter by letter."""

    text: str


class Copyable(NamedTuple):
    """A button that copies a text for another program, such as an address or a command."""

    label: str
    text: str
    """An address within the page begins with a slash, and is copied whole."""


class Download(NamedTuple):
    """A button that hands out a file which was just written."""

    label: str
    """Its name and size."""
    name: str
    address: str
    """URL path of the image."""


class Coloured(NamedTuple):
    """Words in the hue of a colour of the scene, as light or dark as they must be to be read."""

    text: str
    colour: Rgb8


class Key(NamedTuple):
    """One entry of a legend: a dot of a colour and what it means."""

    colour: Rgb8
    text: str


class Link(NamedTuple):
    """Words that lead somewhere."""

    label: str
    to: object
    """The command of the page that a click sends."""
    about: str = ""
    """Tooltip."""


class Address(NamedTuple):
    """A link to an address outside the answer."""

    label: str
    url: str
    in_new_tab: bool = False


class Hint(NamedTuple):
    """Words with more to say on hover, and in brackets if there is none."""

    text: str
    about: str


Inline: TypeAlias = str | Strong | Term | Code | Copyable | Download | Coloured | Key | Link | Address | Hint
"""A piece of a line."""
Line: TypeAlias = tuple[Inline, ...]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """One line or sentence."""

    parts: Line


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells below a head."""

    head: tuple[str, ...]
    """Names of the columns, in the words of the glossary where it has them."""
    rows: tuple[tuple[Line, ...], ...]


class Axis(NamedTuple):
    """An axis of a chart: its label and its range."""

    label: str
    """Name of the quantity, with its unit."""
    first: float
    last: float

    def share(self, value: float) -> float:
        """Return where a value lies, 0 at the first and 1 at the last."""
        return (value - self.first) / max(self.last - self.first, 1e-9)


PROBABILITY = (0.0, 1.0)
"""First and last of an axis of probabilities."""


@dataclass(frozen=True, slots=True)
class StepChart:
    """A quantity that keeps each value until the next."""

    points: tuple[tuple[float, float], ...]
    """(x, y), x ascending."""
    x: Axis
    y: Axis
    colour: Rgb8
    limits: tuple[tuple[float, str], ...] = ()
    """Named values of y."""
    now: float | None = None
    """The moment on show on the x axis."""


@dataclass(frozen=True, slots=True)
class CalibrationChart:
    """Predicted probabilities against how often they came true."""

    cells: tuple[tuple[float, float, int], ...]
    """Predicted probability, share that came true, and count, of each bin."""
    colour: Rgb8


class MarkLane(NamedTuple):
    """Moments of one kind, in a row of their own."""

    name: str
    colour: Rgb8
    times: tuple[float, ...]
    """Seconds, ascending."""


@dataclass(frozen=True, slots=True)
class LaneChart:
    """When things happened: a lane for each kind."""

    lanes: tuple[MarkLane, ...]
    time: Axis
    now: float


class LookMark(NamedTuple):
    """A moment at which an edge was seen open or blocked."""

    time: float
    is_open: bool


@dataclass(frozen=True, slots=True)
class PresenceChart:
    """The probability that an edge is open over the clock of the world, with what was seen of it."""

    points: tuple[tuple[float, float], ...]
    """(time in seconds, p), time ascending; those after `now` are predicted."""
    looks: tuple[LookMark, ...]
    now: float


Chart: TypeAlias = StepChart | CalibrationChart | LaneChart | PresenceChart


class Picture(NamedTuple):
    """An image of the run with its caption."""

    observation: Observation | None
    """None if the image is not at hand."""
    caption: str
    camera: CameraModel
    waypoint: Waypoint | None = None
    """(3,) drawn into it as a pole."""


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Images side by side."""

    pictures: tuple[Picture, ...]

    def __eq__(self, other: object) -> bool:
        """Compare which images they are and what is said of them: an image never changes."""
        return isinstance(other, Pictures) and self._key() == other._key()

    def __hash__(self) -> int:
        """Hash the same."""
        return hash(self._key())

    def _key(self) -> tuple[object, ...]:
        return tuple(
            (
                None if each.observation is None else (each.observation.step, each.observation.stamp),
                each.caption,
                None if each.waypoint is None else tuple(each.waypoint),
            )
            for each in self.pictures
        )


@dataclass(frozen=True, slots=True)
class Pending:
    """Something is being computed; its result will take the place of this."""

    text: str
    title: str = ""
    leave: Link | None = None
    """Gives up waiting."""


Block: TypeAlias = Paragraph | Table | Chart | Pictures | Pending


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a question."""

    blocks: tuple[Block, ...] = ()

    @property
    def is_pending(self) -> bool:
        """Whether a part of it is still being computed."""
        return any(isinstance(block, Pending) for block in self.blocks)

    def links(self) -> Iterator[Link]:
        """Yield all links in the order in which they are read."""
        for block in self.blocks:
            match block:
                case Paragraph(parts):
                    yield from (part for part in parts if isinstance(part, Link))
                case Table(rows=rows):
                    yield from (part for row in rows for cell in row for part in cell if isinstance(part, Link))
                case Pending(leave=Link() as leave):
                    yield leave
                case _:
                    pass


EMPTY_ANSWER = Answer()


@dataclass(slots=True)
class AnswerBuilder:
    """Collects the blocks of an answer."""

    blocks: list[Block] = field(default_factory=list)

    def add_line(self, *parts: Inline | list[Inline]) -> None:
        """Add a line of pieces; a list of pieces counts as its pieces."""
        self.blocks.append(Paragraph(line(*parts)))

    def add_table(self, head: Sequence[str], rows: Iterable[Sequence[Inline | list[Inline]]]) -> None:
        """Add a table; each cell is a piece or a list of pieces."""
        self.blocks.append(Table(tuple(head), tuple(tuple(line(cell) for cell in row) for row in rows)))

    def add_chart(self, chart: Chart) -> None:
        """Add a chart; a line says the same where a quantity never changed."""
        flat = isinstance(chart, StepChart) and len({value for _, value in chart.points}) == 1
        if isinstance(chart, StepChart) and flat:
            value = chart.points[0][1]
            named = f"{value:,.0f}" if chart.y.last > 1 and value == round(value) else f"{value:.2f}"
            self.add_line(f"{chart.y.label}: {named} throughout")
        else:
            self.blocks.append(chart)

    def add_pictures(self, *pictures: Picture) -> None:
        """Add images side by side."""
        self.blocks.append(Pictures(pictures))


def line(*parts: Inline | list[Inline]) -> Line:
    """Return the pieces of a line; a list of pieces among them counts as its pieces."""
    found: list[Inline] = []
    for part in parts:
        if isinstance(part, list):
            found += part
        else:
            found.append(part)
    return tuple(found)


def joined(parts: Iterable[Inline], separator: str = " · ") -> list[Inline]:
    """Return pieces with a separator between them, as a list that `line` takes in."""
    found: list[Inline] = []
    for part in parts:
        found += [separator, part] if found else [part]
    return found
