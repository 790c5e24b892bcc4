"""A system is five strategies: each can be exchanged alone, and the navigator drives whatever it is given."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.method_parts import PARTS, RULES, without_parts
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached, run_query
from ltvn_core.graph.deltas import Cause, EdgePruned, NodeDropped
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import AttemptStarted, Event, GraphChanged, Outcome, Planned
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.systems.registry import OWN_SYSTEMS, open_system
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, observation_at, one_room, tour, two_rooms

PRESETS = pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
IMAGES = list(tour([(0.8, 0.8), (2.3, 2.0), (3.8, 2.0), (5.2, 3.2)]))
GOAL = IMAGES[-1].step


@dataclass
class Drive:
    """A system with its map and a robot at the first image."""

    system: NavigationSystem
    world: FlatWorld = field(default_factory=two_rooms)
    images: Sequence[Observation] = tuple(IMAGES)
    events: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.predictor = FlatPredictor(self.world)
        self.keyframes = KeyframeStore(self.predictor)
        goal, rng = self.images[-1].step, np.random.default_rng(0)
        deltas = self.system.build(self.images, self.keyframes, self.predictor, rng=rng, goals=[goal])
        self.graph = TopologicalGraph(deltas)
        self.poses = {seen.step: seen.exact_pose for seen in self.images if seen.exact_pose is not None}
        self.robot = FlatRobot(self.world, self.poses[0].tolist(), first_step=100_000)

    def go(self, query: int = 0) -> QueryResult:
        goal = self.images[-1].step
        parts = self.robot, self.graph, self.keyframes, self.predictor, self.system, np.random.default_rng(0)
        return run_query(
            Navigator(*parts),
            goal,
            query,
            advance=self.robot.advance,
            verdict=lambda: judge_goal_reached(query, self.robot.pose, self.poses[goal]),
            consume=self.events.append,
        )

    def of(self, kind: type) -> list:
        return [event for event in self.events if isinstance(event, kind)]


@pytest.mark.parametrize("name", sorted({*OWN_SYSTEMS} - {"sgm"}))  # Which needs to know near from nearer.
@PRESETS
def test_the_same_navigator_reaches_the_goal_with_each_system(name: str, method: Method) -> None:
    drive = Drive(open_system(name, method))  # type: ignore[arg-type]
    assert drive.system.name == name
    assert GOAL in drive.graph.nodes
    assert drive.go().reached
    assert drive.robot.collisions == 0


class Forgetful(NoMaintenance):
    """Deletes an edge after any attempt, as SGM does after a failed one."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        edge = attempt.source, attempt.target
        return (EdgePruned(*edge, Cause.ATTEMPT),) if edge in graph.edges else ()


def test_another_maintenance_needs_no_other_navigator() -> None:
    drive = Drive(replace(ltvn_system(ROBUST), maintenance=Forgetful()))
    before = set(drive.graph.edges)
    assert drive.go().reached
    changes = [event.delta for event in drive.of(GraphChanged)]
    assert changes
    assert {type(delta) for delta in changes} == {EdgePruned}
    assert before - set(drive.graph.edges) == {(delta.source, delta.target) for delta in changes}


def test_another_weight_makes_another_path() -> None:
    dense = replace(ROBUST, building=replace(ROBUST.building, merge_distance=0.35))
    drive = Drive(ltvn_system(dense))
    hops = Planner(drive.graph, ROBUST.planning, weight=lambda belief: 1.0).plan(0, GOAL)
    costly = Planner(drive.graph, ROBUST.planning, weight=lambda belief: belief.mu**2).plan(0, GOAL)
    assert hops.cost == len(hops.nodes) - 1
    assert len(hops.nodes) < len(costly.nodes)


def test_a_subgoal_beyond_the_first_node_is_driven_to_in_one_attempt() -> None:
    second: Callable[..., int] = lambda path, reachability: min(2, len(path) - 1)  # noqa: E731
    drive = Drive(replace(ltvn_system(ROBUST), subgoal=second))
    assert drive.go().reached
    for planned, started in zip(drive.of(Planned), drive.of(AttemptStarted), strict=False):
        if started.source is not None and len(planned.nodes) > 2:
            assert (started.source, started.target) == (planned.nodes[0], planned.nodes[2])
            return
    pytest.fail("No leg began at a node.")


def test_a_failure_on_a_long_stretch_makes_all_its_edges_dearer() -> None:
    last: Callable[..., int] = lambda path, reachability: len(path) - 1  # noqa: E731
    method = replace(ROBUST, recovering=replace(ROBUST.recovering, step_limit=200))
    row = [observation_at(np.array([0.6 + 0.6 * k, 1.0, 0.0]), k) for k in range(6)]
    drive = Drive(replace(ltvn_system(method), subgoal=last), one_room(), row)
    wall = np.array([[[2.1, 0.0], [2.1, 4.0]]])
    drive.robot.world = FlatWorld(np.concatenate([drive.world.walls, wall]))
    drive.go()
    first, second = drive.of(Planned)[:2]
    assert first.nodes == (0, 1, 2, 3, 4, 5)
    assert second.nodes[0] > 0
    assert second.cost > ROBUST.planning.failure_penalty * (len(second.nodes) - 1)


@pytest.mark.parametrize("name", ["sptm", "ving"])
def test_a_baselines_map_stays_as_it_was_built(name: str) -> None:
    drive = Drive(open_system(name, ROBUST))  # type: ignore[arg-type]
    before = drive.graph.copy()
    drive.go()
    assert drive.graph == before


def test_without_merging_every_connected_image_is_a_node() -> None:
    whole, bare = Drive(ltvn_system(ROBUST)), Drive(ltvn_system(without_parts(ROBUST, ["merging"])))
    assert len(bare.graph.nodes) + len(bare.graph.reserve) == len(IMAGES)
    assert len(bare.graph.nodes) > 0.9 * len(IMAGES) > 2 * len(whole.graph.nodes)


def test_without_pruning_no_edge_ever_leaves() -> None:
    graph = Drive(ltvn_system(ROBUST)).graph
    source, target = next(iter(graph.edges))
    pruned = {}
    for method in (PAPER, without_parts(PAPER, ["pruning"])):
        trial = graph.copy()
        for _ in range(20):
            for delta in ltvn_system(method).maintenance.after_attempt(
                trial, AttemptEvidence(source, target, 0.5, succeeded=False)
            ):
                trial.apply(delta)
        pruned[method] = (source, target) not in trial.edges
    assert list(pruned.values()) == [True, False]


def test_without_expansion_a_cut_map_stays_cut() -> None:
    outcomes = {}
    for parts in ((), ("expansion",)):
        recovering = replace(ROBUST.recovering, give_up_after_looks=14)
        drive = Drive(ltvn_system(without_parts(replace(ROBUST, recovering=recovering), parts)))
        wall = [node for node in drive.graph.nodes if abs(drive.poses[node][0] - 3.0) < 0.6]
        for node in wall:
            drive.graph.apply(NodeDropped(node, Cause.HAND))
        outcomes[parts] = drive.go().outcome
        causes = {event.delta.cause for event in drive.of(GraphChanged)}
        assert (Cause.EXPAND in causes) == (parts == ())
        assert Cause.NOVEL not in causes or not parts
    assert outcomes == {(): Outcome.ARRIVED, ("expansion",): Outcome.NO_PATH}


def test_leaving_out_nothing_changes_nothing_and_an_unknown_part_is_refused() -> None:
    assert without_parts(PAPER, []) == PAPER
    parts = ["merging", "pruning", "expansion"]
    assert without_parts(ROBUST, parts) == without_parts(without_parts(ROBUST, ["expansion", "merging"]), ["pruning"])
    with pytest.raises(OptionError, match=r"'wheels'.*merging, pruning, expansion"):
        without_parts(ROBUST, ["wheels"])


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_can_be_left_out_alone(rule: str) -> None:
    group, name = rule.split(".")
    bare = without_parts(ROBUST, [rule])

    assert getattr(getattr(bare, group), name) == getattr(getattr(PAPER, group), name)
    restored = replace(getattr(bare, group), **{name: getattr(getattr(ROBUST, group), name)})
    assert replace(bare, **{group: restored}) == ROBUST


def test_without_all_our_departures_the_method_is_the_papers_but_for_limits_and_measured_constants() -> None:
    ours = replace(ROBUST, recovering=replace(ROBUST.recovering, step_limit=77))

    plain = without_parts(ours, [part for part in PARTS if part.startswith("our-")])

    assert plain.recovering.step_limit == 77
    assert replace(plain, recovering=replace(plain.recovering, step_limit=PAPER.recovering.step_limit)) == PAPER
