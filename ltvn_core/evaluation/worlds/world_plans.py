"""Plans of evaluations in a changing world, the paths of their files, and their queries.

All maintenances share drive, weights, first map, script and queries. The queries (time, start, goal, and the edges that
are closed at that time) are drawn once and stored in a file. Drives no robot.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.preparation import DriveGroundTruth
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.results import DoorMove
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.evaluation.worlds.world_truth import ClosedEdges
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, MORNING_S, WorldScript
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import CONTROL_STEP_S, FrameId, NodeId
from ltvn_core.worlds import DoorMoved

WEEK_DAYS = 7.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldPlan:
    """One maintenance in one changing scene with one map seed."""

    trial: TrialPlan
    """Scene, seed and method."""
    world: str
    """Name of a script, or path of its file."""
    maintenance: str
    """Name of the maintenance."""
    queries: int = 700
    days: float = WEEK_DAYS
    """Number of simulated days over which the queries are spread evenly."""

    def __post_init__(self) -> None:
        if self.queries < 1 or not 0 < self.days <= 365:
            raise OptionError(
                "Give one query or more, and more than 0 and at most 365 days, got "
                f"{self.queries} queries in {self.days:g} days."
            )
        longest_s = self.trial.protocol.steps_in(load_scene(self.trial.scene)) * CONTROL_STEP_S
        if self.slot_s < 2 * longest_s:
            raise OptionError(
                f"{self.queries} queries in {self.days:g} days leave {self.slot_s:.0f} s for each, and one may take "
                f"{longest_s:.0f} s; {2 * longest_s:.0f} s are needed. Give more --days or fewer --queries."
            )

    @property
    def slot_s(self) -> float:
        """Mean time from one query to the next, in seconds."""
        return self.days * DAY_S / self.queries

    def script(self, scene: Scene) -> WorldScript:
        """Return the script of the world. Raises WorldError."""
        until_s = MORNING_S + self.days * DAY_S
        return make_script(self.world, scene, seed=self.trial.seed, duration_s=until_s)


@dataclass(frozen=True, slots=True)
class WorldFiles:
    """The paths of the files of a plan."""

    trial: TrialFiles
    """Paths of drive, weights and first map, which do not depend on the maintenance."""
    world: Path
    """Folder of the script and the queries."""
    maintenance: str

    @classmethod
    def of(cls, plan: WorldPlan, trial: TrialFiles) -> "WorldFiles":
        """Return the paths of a plan's files; they are in the folder of its trial without maintenance."""
        folder = f"world-{Path(plan.world).stem}-{plan.queries}-in-{plan.days:g}-days"
        return cls(trial, trial.folder / trial.label / folder, plan.maintenance)

    @property
    def settings(self) -> Path:
        """Path of the settings of the script and the queries."""
        return self.world / "plan.json"

    @property
    def schedule(self) -> Path:
        """Path of the queries, with the edges that are closed at the start of each query."""
        return self.world / "schedule.json"

    def map(self, queries: int) -> Path:
        """Return the path of the map after a number of queries."""
        return self.world / self.maintenance / f"map-{queries:04d}.rrd" if queries else self.trial.map()

    def query_batch(self, first: int, until: int) -> Path:
        """Return the path of the results of the queries from `first` up to `until`."""
        return self.world / self.maintenance / f"queries-{first:04d}-{until:04d}.json"

    @property
    def result(self) -> Path:
        """Path of all results of this maintenance."""
        return self.world / f"{self.maintenance}.world.json"


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
class Schedule:
    """All queries of a plan."""

    queries: tuple[ScheduledQuery, ...]
    edges: tuple[EdgeKey, ...]
    """Edges of the first map that are not spurious."""
    nodes: int
    """Number of nodes of the first map."""
    all_edges: int
    """Number of edges of the first map, including spurious ones."""
    first_frame: FrameId
    """First frame number of the images of the queries."""
    doors: tuple[DoorMove, ...]

    @property
    def changing(self) -> tuple[EdgeKey, ...]:
        """Edges that are closed at some of the scheduled times; predictions are scored on these edges."""
        closed = {edge for query in self.queries for edge in (*query.closed, *query.closed_later)}
        return tuple(edge for edge in self.edges if edge in closed)


def draw_schedule(
    plan: WorldPlan, scene: Scene, graph: TopologicalGraph, truth: GroundTruth, drive_truth: DriveGroundTruth
) -> Schedule:
    """Draw the queries of a plan for its first map. Raises WorldError, and OptionError if no goal can be reached."""
    rng = np.random.default_rng([plan.trial.seed, 7])
    script = plan.script(scene)
    moments = [MORNING_S + (k + rng.uniform(0, 0.5)) * plan.slot_s for k in range(plan.queries)]
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
    return Schedule(tuple(queries), edges, len(graph.nodes), len(graph.edges), max(drive_truth.frames) + 1, doors)


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
