"""`python -m figures.story_strip` draws the moments of a recorded story next to each other."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from figures.story_strip import StoryStripSummary, StoryStripVerb
from ltvn_core import palette
from ltvn_core.data.recording.map_file import LoadedMap, load_map
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, PresenceObserved
from ltvn_core.graph.operators import pose_row
from ltvn_core.navigation.events import (
    ChangedBy,
    Event,
    GraphChanged,
    Outcome,
    Planned,
    QueryEnded,
    QueryStarted,
    StampedEvent,
    WorldChanged,
)
from ltvn_core.worlds import DoorMoved, ThingRemoved
from tests.core.data.recording import example_recording
from tests.repository import DEMO_MAP

pytest.importorskip("embreex")


def story(known: LoadedMap) -> list[Event]:
    """The events of a story on two edges of the demo map."""
    first, second, *_ = known.graph.edges
    unknown = next(
        (first[0], node) for node in known.graph.nodes if (first[0], node) not in known.graph.edges and node != first[0]
    )
    ends = [known.observations[node].exact_pose for node in unknown]
    waypoint = pose_row(relative(*(np.asarray(pose) for pose in ends)))
    new = Edge(*unknown, waypoint, Belief(0.9, 1.0, 0.1))
    closed, opened = (DoorMoved(0, is_open=is_open) for is_open in (False, True))
    return [
        WorldChanged(ThingRemoved("own/high-table-1"), ChangedBy.HAND, 0.0),
        GraphChanged(EdgeAdded(new, Cause.ONLINE)),
        QueryStarted(0, first[1]),
        Planned(0, first, 1.0),
        WorldChanged(closed, ChangedBy.HAND, 1.0),
        GraphChanged(PresenceObserved(*first, present=False, stamp=2.0, cause=Cause.ATTEMPT)),
        *(Planned(0, second, cost) for cost in (1.0, 0.8, 0.6)),
        QueryEnded(0, first[1], Outcome.ARRIVED, steps=1, collisions=0, path_m=1.0),
        WorldChanged(opened, ChangedBy.HAND, 3.0),
        GraphChanged(PresenceObserved(*first, present=True, stamp=4.0, cause=Cause.ATTEMPT)),
        QueryEnded(1, first[1], Outcome.ARRIVED, steps=1, collisions=0, path_m=1.0),
    ]


def test_each_moment_of_a_story_is_drawn(tmp_path: Path) -> None:
    known, path = load_map(DEMO_MAP), tmp_path / "story.rrd"
    step = max(known.observations) + 1
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        writer.write_map(known.graph, known.observations.values())
        for event in story(known):
            writer.write_event(StampedEvent(step, step / 10, event))
    summary = StoryStripVerb(recording=path, output=tmp_path / "strip.png").run()
    assert isinstance(summary, StoryStripSummary)
    assert summary.moments == ("One way is known", "Nodes appear", "Edges fade", "The plan changes", "Edges return")
    drawn = cv2.imread(str(summary.picture))
    assert drawn is not None
    ink = 255 * np.array(palette.EDGE_REMOVED.on_white)
    magenta = np.abs(drawn[..., ::-1] - ink).max(axis=-1) < 20
    fifths = np.array_split(magenta, 5, axis=1)
    assert [bool(each.any()) for each in fifths] == [False, False, True, True, False], "the closed door and its edge"


def test_a_recording_without_a_story_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    example_recording.write(path)
    with pytest.raises(RecordingError, match="holds no story"):
        StoryStripVerb(recording=path, output=tmp_path / "strip.png").run()
