"""Drives queries with maintenance in a scene that does not change.

A query goes from a random image of the mapping drive to a random node. Edges that a query prunes are driven afterwards
to check whether they were bad; the map does not use the result.
"""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np

from ltvn_core.evaluation.edge_driver import EdgeDriver, EdgeProposal, ImagedScene
from ltvn_core.evaluation.episode_runner import EpisodeRunner, open_runner
from ltvn_core.evaluation.plans import RunFiles
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import FrameId


class LifelongDrive:
    """A map after some queries, which further queries change."""

    def __init__(self, files: RunFiles, first: int) -> None:
        """Load the map after `first` queries, with its scene and network."""
        self._plan = files.plan
        self.runner = open_runner(files, first, maintain=True)
        self._drive_truth = prepare(files)
        self._pruned: dict[int, tuple[Edge, ...]] = {}
        """Edges that each query pruned, in their state before the query."""

    def run(self, query: int) -> QueryResult:
        """Drive a query."""
        runner = self.runner
        rng = np.random.default_rng([self._plan.seed, 5, query])
        known = set(runner.map.graph.nodes)
        before = dict(runner.map.graph.edges)
        episode = self._draw(rng)
        result = runner.run(query, episode, rng, first_frame=self._first_frame(query))
        graph = runner.map.graph
        spurious = runner.truth.spurious(runner.map.graph)
        pruned = before.keys() - graph.edges.keys()
        added = graph.edges.keys() - before.keys()
        self._pruned[query] = tuple(before[edge] for edge in pruned)
        return replace(
            result,
            pruned=len(pruned),
            pruned_spurious=sum(_is_spurious(runner, before[edge]) for edge in pruned),
            added_nodes=len(graph.nodes.keys() - known),
            added_edges=len(added),
            added_spurious=len(added & spurious),
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            spurious_edges=len(spurious),
        )

    def check(self, results: Sequence[QueryResult]) -> list[QueryResult]:
        """Check the pruned edges by driving them, and count the bad edges for the query that pruned them."""
        pruned = [self._pruned[result.query] for result in results]
        bad = bad_edges(self.runner, [edge for edges in pruned for edge in edges], self._plan.seed)
        counts = (sum((edge.source, edge.target) in bad for edge in edges) for edges in pruned)
        return [replace(result, pruned_bad=count) for result, count in zip(results, counts, strict=True)]

    def _draw(self, rng: np.random.Generator) -> EpisodePlan:
        """Draw a start and a goal that is not already reached at the start."""
        drive_truth = self._drive_truth
        nodes = sorted(self.runner.map.graph.nodes)
        while True:
            row = int(rng.integers(len(drive_truth.frames)))
            goal = nodes[int(rng.integers(len(nodes)))]
            start_pose = np.array(drive_truth.poses[row])
            goal_pose = self.runner.truth.pose(goal)
            if not judge_goal_reached(0, start_pose, goal_pose).reached:
                return EpisodePlan(
                    start=drive_truth.frames[row],
                    goal=goal,
                    start_pose=pose_row(start_pose),
                    goal_pose=pose_row(goal_pose),
                )

    def _first_frame(self, query: int) -> FrameId:
        """Return the number of a query's first image; a query takes at most one image per step."""
        steps = self._plan.protocol.steps_in(self.runner.scene)
        return max(self._drive_truth.frames) + 1 + query * (steps + 1)


ATTEMPTS_PER_EDGE = 4
"""Number of attempts at each edge (ours)."""
_MAX_STARTS = 3 * ATTEMPTS_PER_EDGE
"""Maximum number of starts per edge; more than the attempts, because a start without localisation does not count."""


def bad_edges(runner: EpisodeRunner, pruned: Iterable[Edge], seed: int) -> set[EdgeKey]:
    """Return the edges that are spurious, or at which fewer than half of the robot's attempts arrived.

    Attempts start at the exact pose of the source with errors within the controller's tolerance. Each edge has a random
    generator of its own, so that the result does not depend on the other edges.
    """
    bad = set[EdgeKey]()
    for edge in pruned:
        key = edge.source, edge.target
        if key not in bad and (_is_spurious(runner, edge) or _mostly_fails(runner, edge, seed)):
            bad.add(key)
    return bad


def _is_spurious(runner: EpisodeRunner, edge: Edge) -> bool:
    return runner.truth.is_spurious((edge.source, edge.target), by_odometry=edge.by_odometry)


def _mostly_fails(runner: EpisodeRunner, edge: Edge, seed: int) -> bool:
    """Return whether fewer than half of the attempts arrive; False if no attempt could start."""
    rng = np.random.default_rng([seed, 6, edge.source, edge.target])
    proposal = EdgeProposal(
        source=edge.source,
        target=edge.target,
        waypoint=np.array(edge.waypoint),
        reachability=edge.belief.p,
        true=True,
        connected=True,
    )
    driven = 0
    arrived = 0
    with closing(
        EdgeDriver(
            _imaged_scene(runner),
            runner.map.predictor,
            runner.map.system.method,
            np.zeros((1, 3)),
            rng,
            noise=runner.noise,
            body=runner.body,
        )
    ) as attempts:
        for _ in range(_MAX_STARTS):
            attempted = attempts.drive(proposal)
            driven += attempted is not None
            arrived += attempted is not None and attempted.arrived
            if driven == ATTEMPTS_PER_EDGE:
                break
    return 2 * arrived < driven


def _imaged_scene(runner: EpisodeRunner) -> ImagedScene:
    """Return the scene with the images of the map."""
    keyframes = runner.map.keyframes
    poses = {frame: runner.truth.pose(frame) for frame in keyframes.frames}
    return ImagedScene(scene=runner.scene, camera=runner.camera, keyframes=keyframes, poses=poses)
