"""An answer of the debugger as data: blocks of text, tables, charts and images, in reading order.

Owns the types of these blocks. Questions make answers; the page renders them as HTML, the command line as text or JSON
(`ltvn_core.analysis.answer_text`). Questions, page and command line do not depend on each other.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.graph.presence.presence_filter import PresenceObservation
from ltvn_core.palette import Rgb8
from ltvn_core.types import Observation, Waypoint


class Strong(NamedTuple):
    """Text with emphasis."""

    text: str


class Term(NamedTuple):
    """A word of the glossary, or a symbol such as p, that shows its definition."""

    word: str
    shown: str = ""
    """Text to show in place of the word; empty for the word itself."""


class Code(NamedTuple):
    """A command or a path that can be copied exactly."""

    text: str


class Copyable(NamedTuple):
    """A button that copies a text for use in another program, such as an address or a command."""

    label: str
    text: str
    """Text to copy. If it begins with a slash, it is an address within the page, and the complete address is copied."""


class Download(NamedTuple):
    """A button that downloads a file which was just written."""

    label: str
    """Name and size of the file."""
    name: str
    address: str
    """URL path of the image."""


class Coloured(NamedTuple):
    """Text in the hue of a colour of the scene, made lighter or darker so that it is readable."""

    text: str
    colour: Rgb8


class Key(NamedTuple):
    """One entry of a legend: a coloured dot and its meaning."""

    colour: Rgb8
    text: str


class Link(NamedTuple):
    """Text that can be clicked to send a command."""

    label: str
    to: object
    """The command that the page sends on a click."""
    about: str = ""
    """Tooltip."""
    is_button: bool = False
    """Whether it is one of the next questions, which the page shows as buttons."""


class Address(NamedTuple):
    """A link to an address outside the answer."""

    label: str
    url: str
    in_new_tab: bool = False


class Hint(NamedTuple):
    """Text with an explanation, shown as a tooltip, or in brackets where there are no tooltips."""

    text: str
    about: str


class Step(NamedTuple):
    """What to do next: what to click in the page, and what to type in a terminal."""

    click: str
    typed: str
    """The same with options of `ltvn why`."""


Inline: TypeAlias = str | Strong | Term | Code | Copyable | Download | Coloured | Key | Link | Address | Hint | Step
"""One piece of a line."""
Line: TypeAlias = tuple[Inline, ...]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """One line or sentence."""

    parts: Line


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells below a header."""

    head: tuple[str, ...]
    """Names of the columns, from the glossary where it has them."""
    rows: tuple[tuple[Line, ...], ...]


class Axis(NamedTuple):
    """An axis of a chart: its label and its range."""

    label: str
    """Name of the quantity with its unit."""
    first: float
    last: float
    is_count: bool = False
    """Whether only whole numbers have a meaning."""

    def share(self, value: float) -> float:
        """Return the position of a value on the axis: 0 at the first value, 1 at the last."""
        return (value - self.first) / max(self.last - self.first, 1e-9)


PROBABILITY = (0.0, 1.0)
"""First and last value of an axis of probabilities."""


@dataclass(frozen=True, slots=True)
class StepChart:
    """A step chart: each value holds until the next one."""

    points: tuple[tuple[float, float], ...]
    """(x, y), x ascending."""
    x: Axis
    y: Axis
    colour: Rgb8
    limits: tuple[tuple[float, str], ...] = ()
    """Named values of y."""
    now: float | None = None
    """The selected moment on the x axis; None for none."""


@dataclass(frozen=True, slots=True)
class CalibrationChart:
    """Predicted probabilities and the share of each that came true."""

    cells: tuple[tuple[float, float, int], ...]
    """Predicted probability, share that came true, and count, for each bin."""
    colour: Rgb8


@dataclass(frozen=True, slots=True)
class PresenceChart:
    """The probability that an edge is open, over the time of the world, with the observations of the edge."""

    points: tuple[tuple[float, float], ...]
    """(time in seconds, p), time ascending; those after `now` are predicted."""
    looks: tuple[PresenceObservation, ...]
    now: float


Chart: TypeAlias = StepChart | CalibrationChart | PresenceChart


_NEAREST_M = 0.05
"""Points nearer to the camera than this are not projected, in metres."""


class Pole(NamedTuple):
    """A vertical pole in an image, as high as the camera: columns and rows of its ends, not rounded.

    Pixels count from the left upper corner; the centre of the first one is (0.5, 0.5). An end may be outside the image.
    """

    top: tuple[float, float]
    foot: tuple[float, float]


def pole_in_image(waypoint: Waypoint, camera: CameraModel) -> Pole | None:
    """Return the pole at a waypoint (3,); None if no part of it is in the image.

    For an edge that is driven backwards, use the image of its target.
    """
    ends = np.array([(*waypoint[:2], height_m) for height_m in (camera.height_m, 0.0)], np.float64)
    ahead_m = (ends - [0.0, 0.0, camera.height_m]) @ camera.rotation[:, 0]
    if (ahead_m < _NEAREST_M).any():
        return None
    top, foot = camera.project(ends) + 0.5
    with np.errstate(divide="ignore", invalid="ignore"):
        # Shares of the way from the top to the foot at which it crosses the borders of the image.
        enter, leave = np.sort((np.array([[0, 0], [camera.width, camera.height]]) - top) / (foot - top), axis=0)
    is_inside = max(0.0, *enter.tolist()) <= min(1.0, *leave.tolist())
    return Pole((float(top[0]), float(top[1])), (float(foot[0]), float(foot[1]))) if is_inside else None


class Picture(NamedTuple):
    """An image of the run with its caption."""

    observation: Observation | None
    """The image; None if it is not available."""
    caption: str
    camera: CameraModel
    waypoint: Waypoint | None = None
    """Waypoint (3,) that is drawn into the image as a pole; None for none."""

    @property
    def pole(self) -> Pole | None:
        """The pole at the waypoint; None if no part of it is in the image."""
        if self.observation is None or self.waypoint is None:
            return None
        tilt = self.observation.tilt
        return pole_in_image(self.waypoint, self.camera if tilt is None else replace(self.camera, **tilt._asdict()))


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Images side by side."""

    pictures: tuple[Picture, ...]

    def __eq__(self, other: object) -> bool:
        """Compare the steps and stamps of the images, captions and waypoints; the pixels of an image never change."""
        return isinstance(other, Pictures) and self._key() == other._key()

    def __hash__(self) -> int:
        """Hash the fields that `__eq__` compares."""
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
    """Placeholder for a result that is still being computed."""

    text: str
    title: str = ""
    leave: Link | None = None
    """Link that cancels the wait."""


Block: TypeAlias = Paragraph | Table | Chart | Pictures | Pending


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a question."""

    blocks: tuple[Block, ...] = ()

    @property
    def is_pending(self) -> bool:
        """Whether a part of the answer is still being computed."""
        return any(isinstance(block, Pending) for block in self.blocks)

    def links(self) -> Iterator[Link]:
        """Yield all links in reading order."""
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
        """Add a line of pieces; a list of pieces is flattened."""
        self.blocks.append(Paragraph(line(*parts)))

    def add_table(self, head: Sequence[str], rows: Sequence[Sequence[Inline | list[Inline]]], of: int = 0) -> None:
        """Add a table, and how many of all `of` rows it leaves out; nothing without rows.

        Each cell is one piece or a list of pieces.
        """
        if rows:
            self.blocks.append(Table(tuple(head), tuple(tuple(line(cell) for cell in row) for row in rows)))
        if of > len(rows):
            self.add_line(f"… and {of - len(rows)} more.")

    def add_chart(self, chart: Chart) -> None:
        """Add a chart, or a line of text if the chart would be constant."""
        if isinstance(chart, StepChart) and len({value for _, value in chart.points}) == 1:
            value = chart.points[0][1]
            named = f"{value:,.0f}" if chart.y.last > 1 and value == round(value) else f"{value:.2f}"
            self.add_line(f"{chart.y.label}: {named} throughout")
        else:
            self.blocks.append(chart)

    def add_pictures(self, *pictures: Picture) -> None:
        """Add images side by side."""
        self.blocks.append(Pictures(pictures))


def line(*parts: Inline | list[Inline]) -> Line:
    """Return the pieces as a line; lists of pieces are flattened."""
    found: list[Inline] = []
    for part in parts:
        if isinstance(part, list):
            found += part
        else:
            found.append(part)
    return tuple(found)


def joined(parts: Iterable[Inline], separator: str = " · ") -> list[Inline]:
    """Return the pieces with a separator between them, as a list for `line`."""
    found: list[Inline] = []
    for part in parts:
        found += [separator, part] if found else [part]
    return found
