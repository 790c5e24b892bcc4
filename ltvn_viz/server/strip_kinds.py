"""The kinds of marks on the timeline at the foot of the page, each with its lane, sign, colour and description.

Owns the table; the page's script gets a copy. Kinds differ in sign as well as in colour, so that no information depends
on colour alone. Colours have one meaning within a lane: orange for failures, magenta for parts that the map lost or
that seem blocked, green for parts that were added or are open, white for changes that people made to the world.
"""

from enum import IntEnum
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.palette import Rgb8


class StripKind(IntEnum):
    """The meaning of a mark; the number is sent to the page. Where marks overlap, the kind with the largest number is
    the most important."""

    DROVE = 0
    """The robot was moving, driven by a person or by a query; a few marks a second."""
    ADDED = 1
    """A single node or edge was added, not with a whole map."""
    REPLANNED = 2
    SEEN_OPEN = 3
    """An edge was seen open again."""
    WORLD_CHANGED = 4
    """An object was placed or removed, or the light changed."""
    DOOR_OPENED = 5
    DOOR_CLOSED = 6
    SEEN_BLOCKED = 7
    PRUNED = 8
    FAILED = 9
    """An attempt did not succeed."""
    COLLISION = 10
    QUERY_BEGAN = 11
    """A query began; the mark has its number and its goal."""
    QUERY_ENDED = 12
    """A query ended; the mark has its number and its `QueryEnd`."""


DROVE_EVERY_S = 0.25
"""Interval between two marks of a robot that moves, in seconds."""


class Lane(IntEnum):
    """The lanes below the queries, from top to bottom."""

    DRIVING = 0
    MAP = 1
    WORLD = 2


LANE_NAMES = {Lane.DRIVING: "driving", Lane.MAP: "map", Lane.WORLD: "world"}


class StripStyle(NamedTuple):
    """The drawing and description of a kind of mark."""

    lane: Lane
    sign: str
    colour: Rgb8
    words: str
    about: str = ""
    """Meaning of the numbers that come with the mark: an edge, a node, or the number of something else."""


STRIP_STYLES: dict[StripKind, StripStyle] = {
    StripKind.DROVE: StripStyle(Lane.DRIVING, "–", palette.ROBOT, "driven"),
    StripKind.ADDED: StripStyle(Lane.MAP, "▲", palette.EDGE_ADDED, "came in", "edge"),
    StripKind.REPLANNED: StripStyle(Lane.DRIVING, "◆", palette.PLAN, "new plan", "edge"),
    StripKind.SEEN_OPEN: StripStyle(Lane.WORLD, "○", palette.EDGE_ADDED, "seen open", "edge"),
    StripKind.WORLD_CHANGED: StripStyle(Lane.WORLD, "◇", palette.TEXT, "world changed"),
    StripKind.DOOR_OPENED: StripStyle(Lane.WORLD, "□", palette.TEXT, "door opened", "number"),
    StripKind.DOOR_CLOSED: StripStyle(Lane.WORLD, "■", palette.TEXT, "door closed", "number"),
    StripKind.SEEN_BLOCKED: StripStyle(Lane.WORLD, "●", palette.EDGE_REMOVED, "seen blocked", "edge"),
    StripKind.PRUNED: StripStyle(Lane.MAP, "▼", palette.EDGE_REMOVED, "pruned", "edge"),
    StripKind.FAILED: StripStyle(Lane.DRIVING, "✕", palette.TARGET, "attempt failed", "edge"),
    StripKind.COLLISION: StripStyle(Lane.DRIVING, "✸", palette.TARGET, "collision"),
}
"""All kinds that are drawn as signs; queries are drawn as bars."""


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
    kinds = {
        int(kind): {
            "lane": int(style.lane),
            "sign": style.sign,
            "colour": style.colour.css,
            "words": style.words,
            "about": style.about,
        }
        for kind, style in STRIP_STYLES.items()
    }
    bars = {int(end): style._asdict() | {"colour": style.colour.css} for end, style in BAR_STYLES.items()}
    return {
        "kinds": kinds,
        "lanes": [LANE_NAMES[lane] for lane in Lane],
        "bars": bars,
        "underWay": UNDER_WAY._asdict() | {"colour": UNDER_WAY.colour.css},
        "drove": int(StripKind.DROVE),
        "droveMs": round(1000 * DROVE_EVERY_S),
        "began": int(StripKind.QUERY_BEGAN),
        "ended": int(StripKind.QUERY_ENDED),
    }
