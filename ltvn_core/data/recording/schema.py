"""Schema of a recording, for writer and reader: versions, names, timelines, entities, columns.

Owns also how one row of exact numbers and texts goes into Rerun beside what the viewer draws, as typed Arrow arrays,
and comes back. `recordings/README.md` explains the same to people.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from ltvn_core.types import FrameId

SCHEMA_VERSION = 1
"""Goes up whenever an older reader could misunderstand the file."""

APPLICATION_ID = "ltvn"
"""Rerun rewrites ids with anything but a-z, 0-9, - and _."""

STEP = "step"
"""Timeline: control steps of the robot, the name of each frame."""
SIM_TIME = "sim_time"
"""Timeline: the robot's clock, as measured."""
EVENT = "event"
"""Timeline: the number of an event. Several events may share a step, so a query by `step` keeps one of them only."""


class RowTime(NamedTuple):
    """The place of a row on the timelines of a recording."""

    step: FrameId
    stamp: float
    """Seconds on the robot's clock."""
    event: int | None = None
    """Number of the event that the row records or draws; None for rows that no event caused."""


PROPERTIES = "ltvn"
"""Name of the recording property that holds `metadata.RecordingMetadata`; Rerun keeps it at /__properties/ltvn."""

WORLD = "world"
SCENE = "world/scene"
ROBOT = "world/robot"
BODY = "world/robot/body"
CAMERA = "world/robot/camera"
RGB = "world/robot/camera/rgb"
DEPTH = "world/robot/camera/depth"
ORIGINAL = "world/robot/camera/original"
ODOMETRY = "world/odometry"
TRAIL = "world/trail"
NODES = "world/graph/nodes"
EDGES = "world/graph/edges"
BLOCKED = "world/graph/blocked"
"""Edges that were seen blocked when they were seen last."""
PRUNED = "world/graph/pruned"
PLAN = "world/plan"
GOAL = "world/goal"
LOCALISED = "world/localised"
WAYPOINT = "world/waypoint"
CHANGES = "world/changes"
"""Present obstacles: door leaves, things, people."""
EVENTS = "events"
LOG = "log"
STATE = "navigator"
GRAPH_SIZE = "graph_size"
BELIEFS = "beliefs"
PROBABILITIES = "beliefs/p"
"""Below it an entity for each edge that was planned, driven or pruned: its p as a scalar."""
LENGTHS = "beliefs/length"
"""Below it an entity for each of these edges: mu and sigma as two scalars."""
BELIEF_TABLE = "belief_table"
"""The edges of the current plan and those that changed last, as text."""
IMAGES = "images"
"""Below it the images of the goal, of the subgoal and of the node at which the robot localised."""
GOAL_IMAGE = "images/goal"
SUBGOAL_IMAGE = "images/subgoal"
NODE_IMAGE = "images/node"
MARGIN = "margin"

OWN_ENTITIES = (
    SCENE,
    ROBOT,
    ODOMETRY,
    TRAIL,
    "world/graph",
    PLAN,
    GOAL,
    LOCALISED,
    WAYPOINT,
    CHANGES,
    EVENTS,
    LOG,
    STATE,
    GRAPH_SIZE,
    BELIEFS,
    BELIEF_TABLE,
    IMAGES,
    MARGIN,
)
"""Entities that are reserved for the recorder, with all entities below them."""
_OWN_BEGINNINGS = tuple(f"{own}/" for own in OWN_ENTITIES)


def is_own_entity(path: str) -> bool:
    """Return whether an entity is written by the recorder and may hold no rows of a user's."""
    path = path.strip("/")
    return path == WORLD or f"{path}/".startswith(_OWN_BEGINNINGS)


READ_BACK = (RGB, DEPTH, ORIGINAL, EVENTS, SCENE)
"""The entities that carry data; all others are drawn only."""

FRAME_ROW = "ltvn.Frame"
"""Exact columns beside the RGB image: stamp, odometry, exact_pose, crc32; tilt if there is one."""
DEPTH_ROW = "ltvn.Depth"
"""Exact columns beside the depth image: crc32."""
ORIGINAL_ROW = "ltvn.Original"
"""Columns beside the original picture: camera (JSON), crc32."""
EVENT_ROW = "ltvn.Event"
"""Columns of an event: sequence, stamp, kind, json, crc32."""
NODE_ROW = "ltvn.Nodes"
"""Columns beside the drawn nodes: node_id."""
EDGE_ROW = "ltvn.Edges"
"""Columns beside the drawn edges: source, target, p, mu, sigma2; beside the blocked ones source and target alone."""

COLUMNS = {
    RGB: {
        STEP: "int64",
        f"{FRAME_ROW}:stamp": "list<item: double>",
        f"{FRAME_ROW}:odometry": "list<item: double>",
        f"{FRAME_ROW}:exact_pose": "list<item: double>",
        f"{FRAME_ROW}:crc32": "list<item: int64>",
        "EncodedImage:blob": "list<item: list<item: uint8 not null>>",
    },
    DEPTH: {STEP: "int64", f"{DEPTH_ROW}:crc32": "list<item: int64>"},
    ORIGINAL: {
        STEP: "int64",
        f"{ORIGINAL_ROW}:camera": "list<item: string>",
        f"{ORIGINAL_ROW}:crc32": "list<item: int64>",
        "EncodedImage:blob": "list<item: list<item: uint8 not null>>",
    },
    EVENTS: {
        STEP: "int64",
        f"{EVENT_ROW}:sequence": "list<item: int64>",
        f"{EVENT_ROW}:stamp": "list<item: double>",
        f"{EVENT_ROW}:kind": "list<item: string>",
        f"{EVENT_ROW}:json": "list<item: string>",
        f"{EVENT_ROW}:crc32": "list<item: int64>",
    },
}
"""Entity -> column -> Arrow type, for what is read back with a time."""


class _Column:
    """A component batch that is already Arrow; Rerun's own guessing of types is slow and remembers the first guess."""

    def __init__(self, array: pa.Array) -> None:
        self._array = array

    def as_arrow_array(self) -> pa.Array:
        return self._array


class ArchetypeColumns(rr.AsComponents):
    """One row of named columns under an archetype name, stored as `<archetype>:<column>`."""

    def __init__(self, archetype: str, columns: Mapping[str, pa.Array]) -> None:
        self._batches = [
            rr.DescribedComponentBatch(_Column(array), rr.ComponentDescriptor(name).with_builtin_archetype(archetype))
            for name, array in columns.items()
        ]

    def as_component_batches(self) -> list[rr.DescribedComponentBatch]:
        """Hand the columns to Rerun."""
        return self._batches


def text_column(*values: str) -> pa.Array:
    """Make a column of texts."""
    return pa.array(values, pa.utf8())


def integer_column(*values: int) -> pa.Array:
    """Make a column of 64-bit integers."""
    return pa.array(values, pa.int64())


def number_column(values: Any, dtype: type[np.generic] = np.float64) -> pa.Array:
    """Make a column of numbers from anything numpy can read. Always copies: the caller may reuse his array."""
    return pa.array(np.array(values, dtype).reshape(-1))


def read_cell(column: pa.Array, index: int) -> NDArray[Any]:
    """Return the numbers of one row of a list column, flat."""
    row = column[index].values  # Three times faster than flattening a slice, which also takes a row without a value.
    if row is None:
        row = column.slice(index, 1).flatten()
    # `.values` of a sliced list would silently start at row 0; only `flatten` honours the offset.
    while pa.types.is_list(row.type) or pa.types.is_fixed_size_list(row.type):
        row = row.flatten()
    return row.to_numpy(zero_copy_only=False)
