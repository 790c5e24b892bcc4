"""Schema of a recording, for writer and reader: versions, names, timelines, entities, columns.

Also owns the exact rows: encoding numbers and texts as typed Arrow arrays beside the data that the viewer draws, and
decoding them. `recordings/README.md` explains the schema to users.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from ltvn_core.readable_text import readable
from ltvn_core.types import FrameId

SCHEMA_VERSION = 1
"""Version of the schema, which increases whenever an older reader could misunderstand the file."""

APPLICATION_ID = "ltvn"
"""Application id in Rerun, which replaces all characters except a-z, 0-9, - and _."""

STEP = "step"
"""Timeline of the robot's control steps, which are the ids of frames."""
SIM_TIME = "sim_time"
"""Timeline of the robot's clock, as measured."""
EVENT = "event"
"""Timeline of event numbers. Several events may have the same step, so a query by `step` returns only one of them."""


class RowTime(NamedTuple):
    """Position of a row on the timelines of a recording."""

    step: FrameId
    stamp: float
    """Time in seconds on the robot's clock."""
    event: int | None = None
    """Number of the event that the row records or draws; None for rows without an event."""


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
"""Edges that were last seen blocked."""
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
"""Parent of one entity for each edge that was planned, driven or pruned, with the edge's p as a scalar."""
LENGTHS = "beliefs/length"
"""Parent of one entity for each edge that was planned, driven or pruned, with its mu and sigma as two scalars."""
BELIEF_TABLE = "belief_table"
"""Text table of the edges of the current plan, and of the edges that changed last."""
IMAGES = "images"
"""Parent of the images of the goal, the subgoal and the node at which the robot localised."""
GOAL_IMAGE = "images/goal"
SUBGOAL_IMAGE = "images/subgoal"
NODE_IMAGE = "images/node"
MARGIN = "margin"
ASKED = "questions/asked"
"""The words of the questions that a person asked the debugger, one row each; copied as rows of a user are."""

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
"""Entities that are reserved for the recorder, including all entities below them."""
_OWN_BEGINNINGS = tuple(f"{own}/" for own in OWN_ENTITIES)


def is_own_entity(path: str) -> bool:
    """Return whether an entity is reserved for the recorder, so that users may not log to it."""
    path = path.strip("/")
    return path == WORLD or f"{path}/".startswith(_OWN_BEGINNINGS)


READ_BACK = (RGB, DEPTH, ORIGINAL, EVENTS, SCENE)
"""Entities that are read back, as are the properties and what users logged; all others are only drawn."""
_READ = frozenset(f"/{entity}" for entity in READ_BACK)


def is_read_back(path: str) -> bool:
    """Tell whether an entity, with a leading slash, is read back; most entities are only drawn."""
    return path in _READ or path.startswith("/__properties") or is_of_user(path)


def is_of_user(path: str) -> bool:
    """Tell whether an entity, with a leading slash, is one that a user logged in addition to the recorder's."""
    return not path.startswith("/__properties") and not is_own_entity(path)


FRAME_ROW = "ltvn.Frame"
"""Exact columns beside the RGB image: stamp, odometry, exact_pose, crc32; tilt if there is one."""
DEPTH_ROW = "ltvn.Depth"
"""Exact columns beside the depth image: crc32."""
ORIGINAL_ROW = "ltvn.Original"
"""Columns beside the original image: camera (JSON), crc32."""
EVENT_ROW = "ltvn.Event"
"""Columns of an event: sequence, stamp, kind, json, crc32."""
DEPTH_PICTURE = "EncodedDepthImage:blob"
"""Column of the depth image, which a robot without a depth camera has not."""
NODE_ROW = "ltvn.Nodes"
"""Columns beside the drawn nodes: node_id."""
EDGE_ROW = "ltvn.Edges"
"""Columns beside the drawn edges: source, target, p, mu, sigma2; beside blocked edges only source and target."""

_NUMBERS, _INTEGERS, _TEXTS = (pa.list_(each) for each in (pa.float64(), pa.int64(), pa.utf8()))
_PICTURE = pa.list_(pa.list_(pa.field("item", pa.uint8(), nullable=False)))
COLUMNS: Mapping[str, Mapping[str, pa.DataType]] = {
    RGB: {
        STEP: pa.int64(),
        f"{FRAME_ROW}:stamp": _NUMBERS,
        f"{FRAME_ROW}:odometry": _NUMBERS,
        f"{FRAME_ROW}:exact_pose": _NUMBERS,
        f"{FRAME_ROW}:crc32": _INTEGERS,
        "EncodedImage:blob": _PICTURE,
    },
    DEPTH: {STEP: pa.int64(), f"{DEPTH_ROW}:crc32": _INTEGERS},
    ORIGINAL: {
        STEP: pa.int64(),
        f"{ORIGINAL_ROW}:camera": _TEXTS,
        f"{ORIGINAL_ROW}:crc32": _INTEGERS,
        "EncodedImage:blob": _PICTURE,
    },
    EVENTS: {
        STEP: pa.int64(),
        f"{EVENT_ROW}:sequence": _INTEGERS,
        f"{EVENT_ROW}:stamp": _NUMBERS,
        f"{EVENT_ROW}:kind": _TEXTS,
        f"{EVENT_ROW}:json": _TEXTS,
        f"{EVENT_ROW}:crc32": _INTEGERS,
    },
}
"""Arrow type of each column that is read back with a time, by entity."""


def has_expected_columns(entity: str, batch: pa.RecordBatch) -> bool:
    """Tell whether the rows of an entity have the columns that this program writes; rows without a time are not
    checked."""
    found = batch.schema
    if found.get_field_index(STEP) < 0:
        return True  # The reader tells of them.
    columns = COLUMNS.get(entity.removeprefix("/"), {}).items()
    places = [(found.get_field_index(name), kind) for name, kind in columns]
    return all(place >= 0 and found.field(place).type == kind for place, kind in places)


class _Column:
    """A component batch that is already in Arrow format; Rerun's own type detection is slow, and keeps the first
    result."""

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
        """Return the columns as Rerun's component batches."""
        return self._batches


def text_column(*values: str) -> pa.Array:
    """Make a column of readable texts."""
    return pa.array([readable(value) for value in values], pa.utf8())


def integer_column(*values: int) -> pa.Array:
    """Make a column of 64-bit integers."""
    return pa.array(values, pa.int64())


def number_column(values: Any, dtype: type[np.generic] = np.float64) -> pa.Array:
    """Make a column of numbers from any numpy-compatible value. Always copies, so that the caller may reuse the
    array."""
    return pa.array(np.array(values, dtype).reshape(-1))


def read_cell(column: pa.Array, index: int) -> NDArray[Any]:
    """Return the numbers of one row of a list column, as a flat array."""
    row = column[index].values  # Three times faster than flattening a slice; None for a row without a value.
    if row is None:
        row = column.slice(index, 1).flatten()
    # `.values` of a sliced list starts at row 0 without a warning; only `flatten` respects the offset.
    while pa.types.is_list(row.type) or pa.types.is_fixed_size_list(row.type):
        row = row[0].values if len(row) == 1 and not row.null_count else row.flatten()  # As above.
    return row.to_numpy(zero_copy_only=False)
