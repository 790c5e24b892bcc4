"""The kinds of marks on the timeline at the foot of the page: in which lane each stands, its sign, colour and words.

Owns the table, of which the page's script gets a copy. Signs differ as well as colours, so that nothing is told by
colour alone. Within a lane a colour has one meaning: orange is what failed, magenta what the map lost or the robot
believes to be shut, green what came or is open; what people did to the world is white.
"""

from enum import IntEnum
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.palette import Rgb8


class StripKind(IntEnum):
    """What a mark stands for; the number goes to the page. The later, the more it matters where marks share a place."""

    ADDED = 0
    """A node or an edge came in, not with a whole map."""
    REPLANNED = 1
    SEEN_OPEN = 2
    """An edge was seen open again."""
    WORLD_CHANGED = 3
    """A thing was put down or taken away, the light changed."""
    DOOR_OPENED = 4
    DOOR_CLOSED = 5
    SEEN_BLOCKED = 6
    PRUNED = 7
    FAILED = 8
    """An attempt did not succeed."""
    COLLISION = 9
    QUERY_BEGAN = 10
    """Of a query, with its number and its goal."""
    QUERY_ENDED = 11
    """Of a query, with its number and its `QueryEnd`."""


class Lane(IntEnum):
    """The lanes below the queries, from top to bottom."""

    DRIVING = 0
    MAP = 1
    WORLD = 2


LANE_NAMES = {Lane.DRIVING: "driving", Lane.MAP: "map", Lane.WORLD: "world"}


class StripStyle(NamedTuple):
    """How a kind of mark is drawn and said."""

    lane: Lane
    sign: str
    colour: Rgb8
    words: str
    about: str = ""
    """What the numbers that come with it are: an edge, a node, or something else by its number."""


STRIP_STYLES: dict[StripKind, StripStyle] = {
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
"""All kinds that are signs; those of queries are bars."""


class QueryEnd(IntEnum):
    """How a query ended, for the colour of its bar."""

    FAILED = 0
    REACHED = 1
    CANCELLED = 2
    WRONG = 3
    """It said that it had arrived, and had not."""


class BarStyle(NamedTuple):
    """How the bar of a query is drawn and said."""

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
    """Return the tables as the page's script reads them."""
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
        "began": int(StripKind.QUERY_BEGAN),
        "ended": int(StripKind.QUERY_ENDED),
    }
