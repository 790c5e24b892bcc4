"""A drive that goes on in the odometry of the one before is joined to it by odometry; no other drive ever is."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core.analysis.edge_explanation import explain_edge
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.joined_drives import is_continued, join_drives
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour

OUT_OF_SIGHT = np.array([50.0, 0.0, 0.0])
DAY_S = 86400.0


def recorded(
    path: Path, seen: Sequence[Observation], config: Mapping[str, Any] | None = None, *, scene: str = "flat"
) -> Recording:
    """Write a drive as it is."""
    with RecordingWriter(path, scene=scene, config=config or {}, fingerprint="flat") as writer:
        for image in seen:
            writer.write_frame(image)
    return Recording.open(path)


def halves() -> tuple[list[Observation], list[Observation]]:
    """Return a drive, cut in two on a straight stretch before a corner."""
    seen = list(tour(((1.0, 1.0), (4.0, 1.0), (4.0, 3.0)), spins=False))
    return seen[:18], seen[18:]


def later(seen: Sequence[Observation], seconds: float) -> list[Observation]:
    """Return images as if they had been taken later."""
    return [replace(image, stamp=image.stamp + seconds) for image in seen]


def unlike(seen: Sequence[Observation]) -> list[Observation]:
    """Return images in which nothing of other places can be recognised."""
    return [replace(image, exact_pose=compose(OUT_OF_SIGHT, image.odometry)) for image in seen]


def restarted(seen: Sequence[Observation]) -> list[Observation]:
    """Return images whose odometry began where the first was taken."""
    return [replace(image, odometry=relative(seen[0].odometry, image.odometry)) for image in seen]


def mapped(folder: Path, *drives: Sequence[Observation]) -> TopologicalMap:
    """Build the map of some drives."""
    joined = join_drives([recorded(folder / f"part-{k}.rrd", seen) for k, seen in enumerate(drives)])
    return build_map(joined.observations, predictor=FlatPredictor(one_room()), drives=joined.drives)


def joints(built: TopologicalMap) -> list[Edge]:
    """Return the edges between nodes of different drives."""
    drive_of = built.graph.drive_of
    return [edge for (source, target), edge in built.graph.edges.items() if drive_of(source) != drive_of(target)]


@pytest.mark.parametrize("pause_s", [1.0, 60.0])
def test_halves_that_no_image_joins_become_one_piece_by_edges_that_say_so(tmp_path: Path, pause_s: float) -> None:
    first, second = halves()
    built = mapped(tmp_path, first, later(unlike(second), pause_s))
    assert len(strongly_connected_components(built.graph)) == 1
    between = joints(built)
    assert {(each.source, each.target) for each in between} == {(each.target, each.source) for each in between}
    for each in between:
        assert each.by_odometry
        poses = [built.keyframes.observation(node).odometry for node in (each.source, each.target)]
        assert np.allclose(each.waypoint, relative(*poses))
    assert "continues part-0.rrd: joined by odometry" in str(built.drives[1])
    assert not any("recognised in the drives before" in doubt for doubt in built.doubts)


def test_three_parts_lie_in_the_frame_of_the_first(tmp_path: Path) -> None:
    seen = [*halves()[0], *halves()[1]]
    built = mapped(tmp_path, seen[:14], later(unlike(seen[14:28]), 1.0), later(seen[28:], 2.0))
    assert len(strongly_connected_components(built.graph)) == 1
    truth = {image.odometry.tobytes() for image in seen}
    assert all(built.keyframes.observation(node).odometry.tobytes() in truth for node in built.graph.nodes)


def test_a_saved_map_still_knows_which_edges_odometry_made_and_tells(tmp_path: Path) -> None:
    first, second = halves()
    built = mapped(tmp_path, first, later(unlike(second), 1.0))
    built.save(tmp_path / "map.rrd")
    assert joints(TopologicalMap.load(tmp_path / "map.rrd", FlatPredictor(one_room()))) == joints(built)
    timeline = Timeline.of(Recording.open(tmp_path / "map.rrd").events)
    joint = joints(built)[0]
    ordinary = next(edge for edge in built.graph.edges.values() if not edge.by_odometry)
    told = [
        " ".join(step.text for step in explain_edge(timeline, edge.source, edge.target)) for edge in (joint, ordinary)
    ]
    assert ["odometry" in text for text in told] == [True, False]


@pytest.mark.parametrize(
    "changed",
    [
        pytest.param(lambda seen: later(restarted(seen), 1.0), id="odometry begins at zero"),
        pytest.param(lambda seen: later(seen, DAY_S), id="another day"),
        pytest.param(lambda seen: later(seen, -1000.0), id="a clock that began anew"),
    ],
)
def test_other_drives_are_not_joined_by_odometry(
    tmp_path: Path, changed: Callable[[list[Observation]], list[Observation]]
) -> None:
    first, second = halves()
    built = mapped(tmp_path, first, changed(unlike(second)))
    assert len(strongly_connected_components(built.graph)) == 2
    assert not joints(built)
    assert not built.drives[1].continues


def test_images_outweigh_odometry_where_the_robot_was_carried_in_a_pause(tmp_path: Path) -> None:
    first, second = halves()
    carried = [
        replace(image, exact_pose=seen.exact_pose)
        for image, seen in zip(second, first, strict=False)  # It stands at the beginning again.
    ]
    built = mapped(tmp_path, first, later(carried, 60.0))
    assert joints(built)
    assert not any(edge.by_odometry for edge in joints(built))
    assert not built.drives[1].continues


def moves(folder: Path, name: str, poses: Sequence[Sequence[float]], begin_s: float, **said: Any) -> Recording:
    """Record images at some poses, a second apart."""
    scene = said.pop("scene", "real:" + name)
    seen = [replace(observation_at(np.array(pose), k), stamp=begin_s + k) for k, pose in enumerate(poses)]
    return recorded(folder / f"{name}.rrd", seen, {"import": said}, scene=scene)


BEFORE = ((0.0, 0.0, 0.0), (3.0, 1.0, 1.0))
GOES_ON = ((3.1, 1.1, 1.1), (4.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("poses", "begin_s", "said", "expected"),
    [
        (GOES_ON, 102.0, {}, True),
        (GOES_ON, 200.0, {}, True),
        (GOES_ON, 300.0, {}, False),
        (GOES_ON, 101.0, {}, False),  # No later than the last image.
        (GOES_ON, 102.0, {"odometry_frame": "odom"}, True),  # Only one of the two names its frame.
        (GOES_ON, 102.0, {"odometry": "truth"}, False),
        (GOES_ON, 102.0, {"scene": "hall 3"}, False),
        (((4.0, 1.0, 1.0), (5.0, 1.0, 1.0)), 103.0, {}, True),  # Driven in two seconds,
        (((4.0, 1.0, 1.0), (5.0, 1.0, 1.0)), 150.0, {}, False),  # but in a long pause nobody drives on unseen.
        (((3.0, 1.0, 2.0), (5.0, 1.0, 1.0)), 150.0, {}, False),
        (((6.0, 1.0, 1.0), (7.0, 1.0, 1.0)), 102.0, {}, False),
        ((GOES_ON[0], GOES_ON[0]), 102.0, {}, False),
    ],
)
def test_time_pose_place_and_source_must_go_on(
    tmp_path: Path, poses: Sequence[Sequence[float]], begin_s: float, said: dict[str, Any], expected: bool
) -> None:
    before = moves(tmp_path, "before", BEFORE, 100.0)
    assert is_continued(before, moves(tmp_path, "after", poses, begin_s, **said)) is expected


def test_frames_of_odometry_that_have_two_names_are_two(tmp_path: Path) -> None:
    before = moves(tmp_path, "before", BEFORE, 100.0, odometry_frame="odom")
    same = moves(tmp_path, "same", GOES_ON, 102.0, odometry_frame="odom")
    other = moves(tmp_path, "other", GOES_ON, 102.0, odometry_frame="visual_odom")
    assert is_continued(before, same)
    assert not is_continued(before, other)


@pytest.mark.parametrize(
    "zero",
    [
        pytest.param((0.0, 0.0, 0.0), id="camera in the middle of the robot"),
        pytest.param((0.2, 0.1, 1.57), id="camera that looks aside"),
        pytest.param((0.9, 0.0, 0.0), id="camera far ahead of the middle"),
    ],
)
def test_a_restart_at_the_place_where_the_robot_had_begun_is_no_continuation(
    tmp_path: Path, zero: tuple[float, float, float]
) -> None:
    x, y, yaw = zero
    before = moves(tmp_path, "before", (zero, (2.0, 0.0, 0.0), (x + 0.1, y + 0.1, yaw)), 100.0)
    assert not is_continued(before, moves(tmp_path, "after", (zero, (2.0, 0.0, 0.0)), 104.0))
