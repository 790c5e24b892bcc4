"""The queries of evaluations in a changing world: time, start, goal, and the edges that are closed at that time.

All maintenances share drive, weights, first map, script and queries, so the queries are drawn once and stored in a
file. Drives no robot.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.plans import RunFiles, RunPlan
from ltvn_core.evaluation.preparation import DriveGroundTruth, prepare
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.results import DoorMove, save_results
from ltvn_core.evaluation.worlds.world_truth import ClosedEdges
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import HOUR_S, MORNING_S
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import CONTROL_STEP_S, FrameId, NodeId
from ltvn_core.worlds import DoorMoved

LATER_S = HOUR_S
"""Time ahead for which presence is predicted, in seconds."""
_LEAST_WAY_M = 1.0
"""Least length of the path from start to goal, in metres."""
_MOST_DRAWS = 1000


@dataclass(frozen=True, slots=True)
class ScheduledQuery:
    """A query, and the world at its start."""

    at_s: float
    episode: EpisodePlan
    shortest_m: float
    """Length of the shortest path at the start of the query, in metres."""
    closed: tuple[EdgeKey, ...]
    """Edges of the first map that are closed at the start of the query."""
    closed_later: tuple[EdgeKey, ...]
    """Edges of the first map that are closed an hour later."""
    detour_m: float = 0.0
    """Additional length of the shortest path compared with the unchanged scene, in metres."""


@dataclass(frozen=True, slots=True)
class WorldSchedule:
    """All queries of a plan."""

    queries: tuple[ScheduledQuery, ...]
    edges: tuple[EdgeKey, ...]
    """Edges of the first map that are not spurious."""
    first_frame: FrameId
    """First frame number of the images of the queries."""
    doors: tuple[DoorMove, ...]

    @property
    def changing(self) -> tuple[EdgeKey, ...]:
        """Edges that are closed at some of the scheduled times; predictions are scored on these edges."""
        closed = {edge for query in self.queries for edge in (*query.closed, *query.closed_later)}
        return tuple(edge for edge in self.edges if edge in closed)


def check_world(plan: RunPlan) -> None:
    """Raise OptionError if the days are too short for the queries, and WorldError if the script is impossible."""
    scene = load_scene(plan.scene)
    schedule = plan.schedule
    longest_s = plan.protocol.steps_in(scene) * CONTROL_STEP_S
    if schedule.slot_s < 2 * longest_s:
        raise OptionError(
            f"{schedule.queries} queries in {schedule.days:g} days leave {schedule.slot_s:.0f} s for each, and one may "
            f"take {longest_s:.0f} s; {2 * longest_s:.0f} s are needed. Give more --days or fewer --queries."
        )
    plan.script(scene)


def draw_world_schedule(files: RunFiles) -> None:
    """Draw the queries of a plan for its first map, unless they exist.

    Raises WorldError, and OptionError if no goal can be reached.
    """
    if files.world_queries.exists():
        return
    plan = files.plan
    scene = load_scene(plan.scene)
    loaded = load_map(files.map(0))
    graph = loaded.graph
    truth = GroundTruth(scene.clearance, loaded.observations.__getitem__)
    drive_truth = prepare(files)
    rng = np.random.default_rng([plan.seed, 7])
    script = plan.script(scene)
    slot_s = plan.schedule.slot_s
    moments = [MORNING_S + (k + rng.uniform(0, 0.5)) * slot_s for k in range(plan.schedule.queries)]
    spurious = truth.spurious(graph)
    edges = tuple(edge for edge in graph.edges if edge not in spurious)
    closed_edges = ClosedEdges(scene, truth)
    closed = {
        at_s: (tuple(closed_edges.among(edges, clearance)), clearance)
        for at_s, clearance in _clearances(World(scene, script), sorted({*moments, *(t + LATER_S for t in moments)}))
    }
    queries = []
    for at_s in moments:
        now, clearance = closed[at_s]
        episode, shortest_m = _draw(clearance, sorted(graph.nodes), truth, drive_truth, rng)
        usual_m = float(scene.clearance.path_lengths(episode.start_pose, episode.goal_pose[:2])[0])
        scheduled = ScheduledQuery(
            at_s=at_s,
            episode=episode,
            shortest_m=shortest_m,
            detour_m=max(shortest_m - usual_m, 0.0),
            closed=now,
            closed_later=closed[at_s + LATER_S][0],
        )
        queries.append(scheduled)
    doors = tuple(
        DoorMove(timed.at_s, timed.change.door, timed.change.is_open)
        for timed in script.changes
        if isinstance(timed.change, DoorMoved)
    )
    save_results(files.world_queries, WorldSchedule(tuple(queries), edges, max(drive_truth.frames) + 1, doors))


def _clearances(world: World, moments: Sequence[float]) -> Iterator[tuple[float, ClearanceMap]]:
    """Yield the clearance map at each time."""
    for at_s in moments:
        if at_s > world.time_s:
            world.skip(at_s - world.time_s)
        yield at_s, world.scene.clearance


def _draw(
    clearance: ClearanceMap,
    nodes: Sequence[NodeId],
    truth: GroundTruth,
    drive_truth: DriveGroundTruth,
    rng: np.random.Generator,
) -> tuple[EpisodePlan, float]:
    """Draw a start from the images of the drive and a goal that can be reached from it; return the path length in
    metres, too."""
    goals = truth.poses(nodes)
    for _ in range(_MOST_DRAWS):
        row = int(rng.integers(len(drive_truth.frames)))
        start = np.array(drive_truth.poses[row])
        if float(clearance.at(start[:2])) < PLANNING_CLEARANCE_M:
            continue
        lengths_m = clearance.path_lengths(start, goals[:, :2])
        free = clearance.at(goals[:, :2]) >= LOCOBOT.clear_radius_m
        possible = np.flatnonzero(np.isfinite(lengths_m) & (lengths_m > _LEAST_WAY_M) & free)
        if len(possible):
            chosen = int(rng.choice(possible))
            episode = EpisodePlan(
                start=drive_truth.frames[row],
                goal=nodes[chosen],
                start_pose=pose_row(start),
                goal_pose=pose_row(goals[chosen]),
            )
            return episode, float(lengths_m[chosen])
    raise OptionError(
        "No goal of the map can be reached from any place; the world is completely closed. Choose another --world."
    )
