"""Several drives become one map: joined where they recognise each other, else in pieces, never by mixed odometry."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import MapError
from ltvn_core.geometry import compose
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.joined_drives import JoinedDrives, join_drives
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import StampedEvent, WorldChanged
from ltvn_core.types import Observation, Pose
from ltvn_core.worlds import TimePassed
from tests.core.flat_world import FlatPredictor, one_room, tour
from tools.joint_table import JointTable

ELSEWHERE = np.array([40.0, -3.0, 1.2])
ROUND = ((1.0, 1.0), (4.0, 1.0), (4.0, 3.0))
BACK = ((4.0, 3.0), (4.0, 1.0), (2.0, 1.0))


def recorded(
    path: Path,
    seen: Iterable[Observation],
    odometry: Callable[[Pose], Pose] = lambda pose: pose,
    *,
    scene: str = "flat",
) -> Recording:
    """Write a drive whose odometry is another than the truth, at 8 o'clock of its world."""
    with RecordingWriter(path, scene=scene, config={}, fingerprint="flat") as writer:
        writer.write_event(StampedEvent(0, 0.0, WorldChanged(TimePassed(0.0), at_s=8 * 3600.0)))
        for image in seen:
            writer.write_frame(replace(image, odometry=odometry(image.odometry)))
    return Recording.open(path)


def elsewhere(pose: Pose) -> Pose:
    """Return a pose in an odometry frame that began somewhere else."""
    return compose(ELSEWHERE, pose)


def two_drives(folder: Path, second: Iterable[Observation]) -> JoinedDrives:
    """Return a drive along a wall and another one, each with its own odometry."""
    return join_drives(
        [recorded(folder / "monday.rrd", tour(ROUND)), recorded(folder / "tuesday.rrd", second, elsewhere)]
    )


def mapped(joined: JoinedDrives, predictor: FlatPredictor | None = None) -> TopologicalMap:
    """Build the map of some drives."""
    return build_map(joined.observations, predictor=predictor or FlatPredictor(one_room()), drives=joined.drives)


@pytest.fixture(scope="module")
def met(tmp_path_factory: pytest.TempPathFactory) -> TopologicalMap:
    """The map of two drives that meet."""
    return mapped(two_drives(tmp_path_factory.mktemp("drives"), tour(BACK)))


@pytest.fixture(scope="module")
def saved(met: TopologicalMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of that map."""
    path = tmp_path_factory.mktemp("map") / "map.rrd"
    met.save(path)
    return path


def test_images_and_times_of_a_later_drive_are_counted_on(tmp_path: Path) -> None:
    joined = two_drives(tmp_path, tour(BACK))
    monday, tuesday = joined.drives
    steps = [seen.step for seen in joined.observations]
    stamps = [seen.stamp for seen in joined.observations]
    assert (monday.name, tuesday.name) == ("monday.rrd", "tuesday.rrd")
    assert tuesday.first == tuesday.added_steps > monday.last
    assert tuesday.first % 1000 == 0
    assert steps == sorted(set(steps))
    assert stamps == sorted(stamps)
    began = next(seen for seen in joined.observations if seen.step == tuesday.first)
    assert began.stamp + tuesday.world_offset_s == pytest.approx(8 * 3600.0)


def test_one_drive_is_taken_as_it_is(tmp_path: Path) -> None:
    alone = recorded(tmp_path / "monday.rrd", tour(ROUND))
    joined = join_drives([alone])
    assert joined.drives == ()
    assert [seen.step for seen in joined.observations] == list(alone.frames)


def test_the_same_recording_twice_is_refused(tmp_path: Path) -> None:
    alone = recorded(tmp_path / "monday.rrd", tour(ROUND))
    with pytest.raises(MapError, match="named twice"):
        join_drives([alone, alone])


@pytest.mark.parametrize(
    ("scenes", "doubts"),
    [
        (("flat", "flat"), 0),
        (("flat", "real:tuesday"), 1),
        (("apartment-57", "apartment-70"), 1),
        (("real:monday", "real:tuesday"), 0),  # Named after their files, of whatever place.
        (("real:monday", "hall 3"), 1),
    ],
)
def test_drives_of_two_places_are_doubted(tmp_path: Path, scenes: tuple[str, str], doubts: int) -> None:
    drives = [recorded(tmp_path / f"{k}.rrd", list(tour(BACK))[:2], scene=scene) for k, scene in enumerate(scenes)]
    assert len(join_drives(drives).findings) == doubts


def test_drives_that_meet_are_one_map_that_lies_as_the_place_does(met: TopologicalMap) -> None:
    built, graph = met, met.graph
    assert len(strongly_connected_components(graph)) == 1
    assert {graph.drive_of(node) for node in graph.nodes} == {1, 2}
    assert built.drives[1].joined_by > 0
    assert (built.drives[1].recognised or 0) > 0.3
    for node, held in graph.nodes.items():
        truth = built.keyframes.observation(node).exact_pose
        assert truth is not None
        assert np.hypot(*(np.array(held.odometry) - truth)[:2]) < 0.1


def test_a_drive_that_nothing_recognises_is_a_piece_of_its_own_and_that_is_said(tmp_path: Path) -> None:
    far = (replace(seen, exact_pose=compose(np.array([50.0, 0, 0]), seen.odometry)) for seen in tour(BACK))
    joined = two_drives(tmp_path, far)
    built = mapped(joined)
    graph = built.graph
    assert len(strongly_connected_components(graph)) == 2
    assert not any(graph.drive_of(source) != graph.drive_of(target) for source, target in graph.edges)
    assert built.drives[1].nodes > 3
    assert "No image of tuesday.rrd was recognised" in built.doubts[0]
    assert built.coverage is not None
    gap = built.coverage.gap
    assert gap is not None
    stamps = [seen.stamp for seen in joined.observations if joined.drives[0].holds(seen.step)]
    assert (gap.drive, gap.begin_s) == ("monday.rrd", 0.0)
    assert gap.end_s == pytest.approx(stamps[-1] - stamps[0])


def test_one_perceptual_alias_joins_no_drives(tmp_path: Path) -> None:
    far = [replace(seen, exact_pose=compose(np.array([50.0, 0, 0]), seen.odometry)) for seen in tour(BACK)]
    joined = two_drives(tmp_path, far)
    here, there = joined.observations[10].step, joined.drives[1].first + 60
    lies = {(there, here): np.array([0.3, 0.0, 0.0]), (here, there): np.array([-0.3, 0.0, 0.0])}
    built = mapped(joined, FlatPredictor(one_room(), lies=lies))
    assert len(strongly_connected_components(built.graph)) == 2


def test_a_saved_map_still_knows_its_drives(met: TopologicalMap, saved: Path) -> None:
    loaded = TopologicalMap.load(saved, FlatPredictor(one_room()))
    first = met.drives[1].first
    assert loaded.graph.drives == {0: "monday.rrd", first: "tuesday.rrd"}
    assert loaded.keyframes.drive_starts == (0, first)
    before = max(frame for frame in loaded.keyframes.frames if frame < first)
    assert all(frame < first for frame in loaded.keyframes.temporal_window(before, 5))


def test_the_joints_of_a_map_are_judged_by_true_poses(saved: Path) -> None:
    (row,) = JointTable(map=saved).run().rows
    name, _, places, median, _, lies = row
    assert name == "tuesday.rrd"
    assert int(places.split()[0]) > 0
    assert float(median.split()[0]) < 0.1
    assert float(lies.split()[0]) < 0.1
    (moved,) = JointTable(map=saved, moved=(3.0, 4.0, 0.0)).run().rows
    assert float(moved[-1].split()[0]) == pytest.approx(5.0, abs=0.1)


def test_the_map_of_one_drive_has_no_joints(tmp_path: Path) -> None:
    mapped(join_drives([recorded(tmp_path / "monday.rrd", tour(ROUND))])).save(tmp_path / "map.rrd")
    with pytest.raises(MapError, match="a map of one drive"):
        JointTable(map=tmp_path / "map.rrd").run()


def beside_shelves(seen: Observation, door_x: float | None) -> Observation:
    """Return an image that shows shelves at both sides of the way, and a closed door ahead if there is one."""
    depth = np.full((72, 96), 5.0, np.float32)
    depth[:, :16] = depth[:, 80:] = 0.8
    if door_x is not None and door_x - seen.odometry[0] < 1.5:
        depth[:, 16:80] = door_x - seen.odometry[0]
    return replace(seen, depth=depth)


def test_what_a_later_drive_sees_blocked_is_observed_so_and_told(tmp_path: Path) -> None:
    monday = [beside_shelves(seen, None) for seen in tour(((0.5, 2.0), (4.5, 2.0)), spins=False)]
    tuesday = [beside_shelves(seen, 2.6) for seen in tour(((0.5, 2.0), (1.8, 2.0)), spins=False)]
    joined = join_drives(
        [recorded(tmp_path / "monday.rrd", monday), recorded(tmp_path / "tuesday.rrd", tuesday, elsewhere)]
    )
    built = mapped(joined)
    places = {node: built.keyframes.observation(node).exact_pose for node in built.graph.nodes}
    blocked = built.drives[1].blocked
    assert blocked
    for source, target in blocked:
        ends = sorted(float(pose[0]) for node in (source, target) if (pose := places[node]) is not None)
        assert ends[0] < 2.7
        assert ends[1] > 2.5
    assert {edge for edge, seen in built.graph.presence.items() if not seen[-1].present} == set(blocked)
    assert f"{len(blocked)} edges seen blocked" in str(built.drives[1])


def test_images_of_another_drive_are_no_neighbours_in_time_though_odometry_agrees() -> None:
    seen = list(tour(((1.0, 1.0), (4.0, 1.0)), spins=False))
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    keyframes.begin_drives([seen[10].step])
    keyframes.add(seen)
    assert max(keyframes.temporal_window(seen[9].step, 4)) < seen[10].step
    assert min(keyframes.temporal_window(seen[10].step, 4)) > seen[10].step
    assert keyframes.temporal_neighbours(seen[9].step, 1.0) == (seen[8].step,)


def moved_far(seen: Iterable[Observation]) -> Iterable[Observation]:
    """Return the same drive at another place, where nothing is recognised."""
    return (replace(each, exact_pose=compose(np.array([50.0, 0, 0]), each.odometry)) for each in seen)


@pytest.mark.slow
@pytest.mark.parametrize("second", [lambda: tour(BACK), lambda: moved_far(tour(BACK))], ids=["meet", "never meet"])
def test_joining_drives_asks_at_most_half_as_much_again_as_mapping_them(
    tmp_path: Path, second: Callable[[], Iterable[Observation]]
) -> None:
    drives = [recorded(tmp_path / "monday.rrd", tour(ROUND)), recorded(tmp_path / "tuesday.rrd", second(), elsewhere)]

    def questions(*recordings: Recording) -> int:
        predictor = FlatPredictor(one_room())
        mapped(join_drives(recordings), predictor)
        return predictor.compared

    assert questions(*drives) <= 1.5 * sum(questions(drive) for drive in drives)
