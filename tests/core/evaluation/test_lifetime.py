"""Queries with maintenance in a house of two rooms: an oracle drives, and false edges through the wall must go."""

import itertools
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("embreex")

from ltvn_core.data.recording.map_file import load_map, save_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.episode_runner import open_runner
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.lifelong_drive import bad_edges
from ltvn_core.evaluation.plans import RunFiles, RunPlan, Schedule
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.protocol import EvaluationProtocol
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.results import Run, read_queries
from ltvn_core.evaluation.runner import batch_ranges, finished_run, run_query_batch
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.verbs.lifelong import LifelongSummary, LifelongVerb
from tests.core.simulation.two_room_mesh import box_house, save

pytestmark = pytest.mark.slow


WALL_X = 3.0
FALSE_EDGES = 15
QUERIES = 4
SCHEDULE = Schedule(queries=3, every=2)
SURE = Belief(0.9, 0.05, 0.01)
"""Of an edge that is not there; so short that the planner likes it."""


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Map the house once, and plant false edges into the map; no test may change the folder."""
    folder = tmp_path_factory.mktemp("mapped")
    save(box_house(), folder / "house.glb")
    prepare(files(folder))
    plant(files(folder))
    return folder


@pytest.fixture(scope="module")
def lived(mapped: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drive all queries in one go."""
    folder = copied(mapped, tmp_path_factory.mktemp("lived"))
    drive_queries(folder, 0, QUERIES)
    return folder


def copied(mapped: Path, folder: Path) -> Path:
    return Path(shutil.copytree(mapped, folder, dirs_exist_ok=True))


def plan(folder: Path) -> RunPlan:
    protocol = EvaluationProtocol(loops=1, goals=3, episodes=3, step_limit=300)
    return RunPlan(scene=str(folder / "house.glb"), seed=0, predictor="oracle", protocol=protocol, schedule=SCHEDULE)


def files(folder: Path) -> RunFiles:
    return RunFiles.of(plan(folder), folder / "runs")


def plant(where: RunFiles) -> None:
    """Add edges between places of different rooms that nobody can drive."""
    loaded = load_map(where.map())
    truth = GroundTruth(load_scene(loaded.meta.scene).clearance, loaded.observations.__getitem__)
    west = [node for node in loaded.graph.nodes if truth.pose(node)[0] < WALL_X]
    east = [node for node in loaded.graph.nodes if truth.pose(node)[0] > WALL_X]
    ends = zip(itertools.cycle(west), itertools.cycle(east), strict=False)
    false = itertools.islice((edge for edge in ends if truth.is_spurious(edge)), FALSE_EDGES)
    for source, target in (edge for pair in false for edge in (pair, pair[::-1])):
        waypoint = pose_row(relative(truth.pose(source), truth.pose(target)))
        loaded.graph.apply(EdgeAdded(Edge(source, target, waypoint, SURE, attempts=2), Cause.HAND))
    where.map().unlink()
    about = {"scene": loaded.meta.scene, "fingerprint": loaded.meta.fingerprint, "config": {}}
    save_map(where.map(), loaded.graph, loaded.observations.values(), **about)


def drive_queries(folder: Path, first: int, until: int) -> None:
    run_query_batch(files(folder), first, until)


def graph(folder: Path, queries: int) -> TopologicalGraph:
    return load_map(files(folder).map(queries)).graph


def queries(folder: Path, first: int, until: int) -> tuple[QueryResult, ...]:
    return tuple(read_queries(files(folder).query_batch(first, until)))


def test_false_edges_that_were_driven_leave_the_map_and_count_as_bad(lived: Path) -> None:
    truth = open_runner(files(lived)).truth
    before, after = graph(lived, 0), graph(lived, QUERIES)
    gone = before.edges.keys() - after.edges.keys()
    driven = queries(lived, 0, QUERIES)
    assert [query.query for query in driven] == list(range(QUERIES))
    assert gone
    assert all(truth.is_spurious(edge) for edge in gone)
    assert sum(query.pruned for query in driven) == len(gone)
    assert sum(query.pruned_bad for query in driven) == sum(query.pruned_spurious for query in driven) == len(gone)
    assert driven[-1].edges == len(after.edges)
    assert driven[-1].spurious_edges == 2 * FALSE_EDGES - len(gone)


def test_what_driving_taught_is_in_the_saved_map(lived: Path) -> None:
    successes = sum(edge.successes for edge in graph(lived, QUERIES).edges.values())
    assert successes >= sum(query.reached for query in queries(lived, 0, QUERIES)) > 0


def test_two_stretches_come_to_the_same_as_one(mapped: Path, lived: Path, tmp_path: Path) -> None:
    folder = copied(mapped, tmp_path)
    drive_queries(folder, 0, QUERIES // 2)
    drive_queries(folder, QUERIES // 2, QUERIES)
    assert graph(folder, QUERIES) == graph(lived, QUERIES)
    assert list(graph(folder, QUERIES).edges) == list(graph(lived, QUERIES).edges)
    assert (*queries(folder, 0, QUERIES // 2), *queries(folder, QUERIES // 2, QUERIES)) == queries(lived, 0, QUERIES)


def test_a_stretch_cut_off_before_its_last_file_is_finished_and_one_that_is_done_is_left_alone(
    mapped: Path, tmp_path: Path
) -> None:
    folder = copied(mapped, tmp_path)
    drive_queries(folder, 0, 2)
    told, kept = files(folder).query_batch(0, 2), files(folder).map(2).read_bytes()
    before = queries(folder, 0, 2)
    told.unlink()
    drive_queries(folder, 0, 2)
    assert queries(folder, 0, 2) == before
    written = told.stat().st_mtime_ns
    drive_queries(folder, 0, 2)
    assert told.stat().st_mtime_ns == written
    assert files(folder).map(2).read_bytes() == kept


def test_images_are_not_compressed_again_from_map_to_map(lived: Path) -> None:
    first, last = (Recording.open(files(lived).map(queries)) for queries in (0, QUERIES))
    assert set(first.frames) <= set(last.frames)
    assert all(first.stored_frame(frame).frame.rgb == last.stored_frame(frame).frame.rgb for frame in first.frames)


def test_an_edge_that_a_robot_drives_well_is_not_bad(mapped: Path) -> None:
    runner = open_runner(files(mapped), maintain=True)
    spurious = runner.truth.spurious(runner.map.graph)
    good = [edge for key, edge in runner.map.graph.edges.items() if key not in spurious][:2]
    false = [runner.map.graph.edges[key] for key in sorted(spurious)[:2]]
    assert bad_edges(runner, [*good, *false], seed=0) == {(edge.source, edge.target) for edge in false}


def test_a_lifelong_test_has_a_static_test_at_each_point_and_is_only_read_the_second_time(
    mapped: Path, tmp_path: Path
) -> None:
    folder = copied(mapped, tmp_path)
    lived, result = live(folder)
    assert [known.after for known in result.maps] == [0, 2, 3]
    assert [len(known.episodes) for known in result.maps] == [2, 2, 2]
    assert [known.map.edges for known in result.maps] == [len(graph(folder, k).edges) for k in (0, 2, 3)]
    assert [query.query for query in result.queries] == [0, 1, 2]
    life = lived.by_scene["house"]
    assert (life.before.queries, life.after.queries, life.queries) == (0, 3, 3)
    assert life.before.edges - life.pruned + life.added_edges == life.after.edges
    assert life.pruned_bad_share == 1
    again, same = live(folder)
    assert same == result
    assert again.by_scene == lived.by_scene


def live(folder: Path) -> tuple[LifelongSummary, Run]:
    """Run the whole test as a user would."""
    verb = LifelongVerb(
        scene=(str(folder / "house.glb"),),
        predictor="oracle",
        loops=1,
        goals=3,
        step_limit=300,
        queries=3,
        every=2,
        episodes=2,
        folder=folder / "runs",
        processes=1,
    )
    lived = verb.run()
    assert isinstance(lived, LifelongSummary)
    plans = replace(plan(folder), protocol=replace(plan(folder).protocol, episodes=2))
    run = finished_run(plans, folder / "runs")
    assert run is not None
    return lived, run


def test_a_schedule_tests_before_in_between_and_after() -> None:
    assert Schedule(queries=700).tests == (0, 100, 200, 300, 400, 500, 600, 700)
    assert Schedule(queries=10, every=4).tests == (0, 4, 8, 10)
    assert Schedule(queries=5).tests == (0, 5)
    assert batch_ranges(100, 160) == [(100, 125), (125, 150), (150, 160)]
    with pytest.raises(OptionError, match="every 0"):
        Schedule(every=0)
