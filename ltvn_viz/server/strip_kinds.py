"""The kinds of marks on the timeline at the foot of the page, each with its lane, sign, colour and description.

Owns the table; the page's script gets a copy. Kinds differ in sign as well as in colour, so that no information depends
on colour alone. Colours have one meaning within a lane: orange for failures and a lower p, blue for a higher one,
magenta for parts that the map lost or that seem blocked, green for parts that were added or are open, white for changes
that people made to the world.
"""

from enum import IntEnum, StrEnum
from typing import NamedTuple, TypeAlias

from ltvn_core import palette
from ltvn_core.navigation.event_table import MarkKind
from ltvn_core.palette import Rgb8


class StripKind(StrEnum):
    """The meaning of a mark that the page's timeline alone has; it shows the kinds of `MarkKind` too."""

    RECORDED = "recorded"
    DRIVEN_BY_PERSON = "driven by person"
    """The robot moved, and no query was under way."""
    DRIVEN_BY_QUERY = "driven by query"
    PEOPLE_MOVED = "people moved"
    PLANNED = "planned"
    """The first path of a query."""
    ROSE = "rose"
    """The probability of an edge rose after an attempt."""
    FELL = "fell"
    NO_PLAN = "no plan"


ShownKind: TypeAlias = StripKind | MarkKind


class Lane(StrEnum):
    """The lanes below the queries, from top to bottom, by their names."""

    RECORDING = "recording"
    DRIVING = "driving"
    PLAN = "plan"
    EDGES = "edges"
    WORLD = "world"


class StripStyle(NamedTuple):
    """The drawing and description of a kind of mark."""

    lane: Lane
    sign: str
    colour: Rgb8
    words: str
    about: str = ""
    """Meaning of the numbers that come with the mark: an edge, the ends of a path, or the number of a door."""
    span_s: float = 0.0
    """Duration in seconds of what goes on for some time: there is one mark at most in so long, and each is drawn as a
    bar that ends with it. 0 for an event."""
    share: float = 1.0
    """Height of the bar as a share of its lane, so that bars of one lane differ without their colours."""


STRIP_STYLES: dict[ShownKind, StripStyle] = {
    StripKind.RECORDED: StripStyle(Lane.RECORDING, "▬", palette.COURSE, "images", "", 1.0, 0.5),
    StripKind.DRIVEN_BY_PERSON: StripStyle(Lane.DRIVING, "▂", palette.ROBOT, "driven by a person", "", 0.25, 0.25),
    StripKind.DRIVEN_BY_QUERY: StripStyle(Lane.DRIVING, "▅", palette.SOURCE, "driven by a query", "", 0.25, 0.5),
    StripKind.PEOPLE_MOVED: StripStyle(Lane.WORLD, "▁", palette.TEXT, "people walk", "", 0.5, 0.25),
    MarkKind.ADD: StripStyle(Lane.EDGES, "▲", palette.EDGE_ADDED, "came in", "edge"),
    StripKind.PLANNED: StripStyle(Lane.PLAN, "◇", palette.PLAN, "plan made", "path"),
    MarkKind.REPLAN: StripStyle(Lane.PLAN, "◆", palette.PLAN, "plan changed", "path"),
    StripKind.ROSE: StripStyle(Lane.EDGES, "↑", palette.SOURCE, "p rose", "edge"),
    MarkKind.SEEN_OPEN: StripStyle(Lane.EDGES, "○", palette.EDGE_ADDED, "seen open", "edge"),
    MarkKind.WORLD: StripStyle(Lane.WORLD, "◈", palette.TEXT, "world changed"),
    MarkKind.DOOR_OPENED: StripStyle(Lane.WORLD, "□", palette.TEXT, "door opened", "number"),
    MarkKind.DOOR_CLOSED: StripStyle(Lane.WORLD, "■", palette.TEXT, "door closed", "number"),
    StripKind.FELL: StripStyle(Lane.EDGES, "↓", palette.TARGET, "p fell", "edge"),
    MarkKind.SEEN_BLOCKED: StripStyle(Lane.EDGES, "●", palette.EDGE_REMOVED, "seen blocked", "edge"),
    MarkKind.PRUNE: StripStyle(Lane.EDGES, "▼", palette.EDGE_REMOVED, "pruned", "edge"),
    StripKind.NO_PLAN: StripStyle(Lane.PLAN, "∅", palette.TARGET, "no path found"),
    MarkKind.FAILURE: StripStyle(Lane.DRIVING, "✕", palette.TARGET, "attempt failed", "edge"),
    MarkKind.COLLISION: StripStyle(Lane.DRIVING, "✸", palette.TARGET, "collision"),
}
"""All kinds but those of queries, which are drawn as bars above the lanes: what they are, and where and how they are
drawn. Where marks overlap, the later kind is the more important."""
KIND_NUMBERS = {kind: number for number, kind in enumerate((*STRIP_STYLES, MarkKind.QUERY_START, MarkKind.QUERY_END))}
"""Kind -> the number that is sent to the page."""


class QueryEnd(IntEnum):
    """How a query ended, for the colour of its bar."""

    FAILED = 0
    REACHED = 1
    CANCELLED = 2
    WRONG = 3
    """The robot reported that it had arrived, but it had not."""


class BarStyle(NamedTuple):
    """The drawing and description of a query's bar."""

    sign: str
    colour: Rgb8
    words: str


UNDER_WAY = BarStyle("…", palette.SOURCE, "under way")
BAR_STYLES: dict[QueryEnd, BarStyle] = {
    QueryEnd.FAILED: BarStyle("✕", palette.TARGET, "failed"),
    QueryEnd.REACHED: BarStyle("✓", palette.EDGE_ADDED, "reached"),
    QueryEnd.CANCELLED: BarStyle("–", palette.COURSE, "cancelled"),
    QueryEnd.WRONG: BarStyle("≠", palette.EDGE_REMOVED, "wrong arrival"),
}


def strip_tables() -> dict[str, object]:
    """Return the tables in the format of the page's script."""
    lanes = [*Lane]
    kinds = {
        KIND_NUMBERS[kind]: style._asdict() | {"lane": lanes.index(style.lane), "colour": style.colour.css}
        for kind, style in STRIP_STYLES.items()
    }
    bars = {int(end): style._asdict() | {"colour": style.colour.css} for end, style in BAR_STYLES.items()}
    return {
        "kinds": kinds,
        "lanes": lanes,
        "bars": bars,
        "underWay": UNDER_WAY._asdict() | {"colour": UNDER_WAY.colour.css},
        "began": KIND_NUMBERS[MarkKind.QUERY_START],
        "ended": KIND_NUMBERS[MarkKind.QUERY_END],
    }
