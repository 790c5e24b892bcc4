"""`ltvn evaluate-robot`: the paper's test on a robot (its Table II): episodes, queries with maintenance, episodes.

Each result is saved before the next episode begins, so that an interrupted run, or one that lost its robot, can
continue. Owns the order, the goals and the choice of the judge.
"""

import logging
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.sole_writer import sole_user
from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.query_result import QueryResult
    from ltvn_core.network.metrics import SuccessRate
    from ltvn_core.robots.robot import Robot
    from ltvn_core.types import NodeId, Observation, Pose
    from ltvn_core.verbs.navigate import NavigateVerb

_LOG = logging.getLogger(__name__)
Phase = Literal["before", "queries", "after"]
PHASES: tuple[Phase, ...] = get_args(Phase)


@dataclass(frozen=True)
class RobotEvaluationSummary:
    """Success of a robot before and after it learned from queries."""

    robot: str
    map: Path
    before: "SuccessRate"
    queries: "SuccessRate"
    after: "SuccessRate"
    judged_by: tuple[str, ...]
    """Judges of the arrivals: truth, person or belief."""
    pruned: int
    """Number of edges that were pruned in the queries."""
    added: int
    """Number of nodes and edges that were added in the queries."""
    driven_m: float
    folder: Path
    """Folder of episodes.jsonl, the recordings and the maps; a second call of the verb continues from them."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class EvaluateRobotVerb(Verb):
    """Test what your own robot learns, in real time: episodes without maintenance, queries with it, and the same
    episodes again."""

    robot: Positional[str]
    """The robot: the name of an installed one, path/to/file.py:factory, or PROFILE@ADDRESS (ROS 2)."""
    map: Path
    """The map of the robot's surroundings; it is read, never changed."""
    episodes: int = 20
    """Number of random episodes before the queries; the same ones follow after the queries."""
    queries: int = 30
    """Number of queries with maintenance, between the episodes."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    seed: int = 0
    """Seed of the goals."""
    folder: FilledFolder = Path("runs/evaluation/robot")
    """Folder of episodes, recordings and maps; the next call continues from them."""

    def run(self) -> RobotEvaluationSummary:
        """Run all episodes and queries that have no result yet. Raises RobotError if the robot is lost, MapError,
        RecordingError and OptionError."""
        from ltvn_core.verbs.robot_queries import opened_robot

        if self.episodes < 1 or self.queries < 0:
            raise OptionError("--episodes must be 1 or more, and --queries 0 or more.")
        begun_s = time.monotonic()
        self.folder.mkdir(parents=True, exist_ok=True)
        with sole_user(self.folder / "episodes"), opened_robot(self.robot) as own:
            for phase, results in _results(self).items():
                if len(results) < _count(self, phase):
                    _run_phase(self, phase, own, len(results))
        return _summary(self, time.monotonic() - begun_s)


def _count(options: EvaluateRobotVerb, phase: Phase) -> int:
    """Return the number of episodes in a phase."""
    return options.queries if phase == "queries" else options.episodes


def _log(options: EvaluateRobotVerb) -> Path:
    """Return the file with all results so far."""
    return options.folder / "episodes.jsonl"


def _results(options: EvaluateRobotVerb) -> "dict[Phase, list[QueryResult]]":
    """Return the stored results of each phase, up to the first missing one."""
    from ltvn_core.evaluation.query_result import read_query_log

    found = {(each.phase, each.query): each for each in read_query_log(_log(options))}
    keys = {phase: [(phase, number) for number in range(_count(options, phase))] for phase in PHASES}
    return {phase: [found[key] for key in takewhile(found.__contains__, keys[phase])] for phase in PHASES}


def _run_phase(options: EvaluateRobotVerb, phase: Phase, own: "Robot", done: int) -> None:
    """Run the remaining episodes of a phase; the map is saved before the result of a query."""
    import numpy as np

    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.evaluation.query_result import QueryResult, append_to_log
    from ltvn_core.systems.maintenance import with_maintenance
    from ltvn_core.verbs.robot_queries import RobotQueries, continued_robot

    count = _count(options, phase)
    goals = _goals(options, phase)
    learned = options.folder / f"map-{done if phase == 'queries' else options.queries}.rrd"
    drive = _drive_options(options, learned if phase != "before" and learned.exists() else options.map)
    known = drive.open_map()
    if phase != "queries":
        known = replace(known, system=with_maintenance(known.system, "static"))
    robot = continued_robot(own, known)
    run = RunDescription(
        scene=known.scene,
        config={
            **drive.settings(known),
            "verb": "evaluate",
            "robot": options.robot,
            "phase": phase,
            **own.spec.needed_space.to_config(),
        },
        fingerprint=known.predictor.fingerprint,
        camera=robot.spec.camera,
        scene_glb=known.scene_glb,
    )
    rng = np.random.default_rng([options.seed, PHASES.index(phase), done])
    with run.open_writer(options.folder / time.strftime(f"{phase}-{done}-%Y%m%d-%H%M%S.rrd")) as writer:
        writer.write_map(known.graph, known.observations)
        driver = RobotQueries(robot, writer, known, rng)
        for number in range(done, count):
            goal = goals[number]
            begun_s = time.monotonic()
            if goal in known.graph.nodes:
                result = _judged(own, known.keyframes.observation(goal), driver.drive_to(goal, number))
            else:
                result = QueryResult(query=number, goal=goal, reached=False, outcome="gone", judged_by="belief")
            if phase == "queries":
                saved = options.folder / f"map-{number + 1}.rrd"
                run.save_map(saved, known.graph, known.observations, origin=options.map)
                (options.folder / f"map-{number}.rrd").unlink(missing_ok=True)
            append_to_log(_log(options), replace(result, phase=phase, seconds=time.monotonic() - begun_s))
            _LOG.info("%s, %d of %d: %s", phase, number + 1, count, "reached" if result.reached else "not reached")


def _drive_options(options: EvaluateRobotVerb, map_file: Path) -> "NavigateVerb":
    """Return the options of `ltvn navigate` for a map."""
    from ltvn_core.verbs.navigate import NavigateVerb

    return NavigateVerb(
        map=map_file,
        recording=options.folder,
        preset=options.preset,
        predictor=options.predictor,
        weights=options.weights,
        seed=options.seed,
    )


def _goals(options: EvaluateRobotVerb, phase: Phase) -> "Sequence[NodeId]":
    """Return the goals of a phase, which are nodes of the original map; they are the same before and after the
    queries."""
    import numpy as np

    from ltvn_core.data.recording.map_file import load_map
    from ltvn_core.evaluation.query_run import random_goals

    nodes = sorted(load_map(options.map).graph.nodes)
    return random_goals(nodes, _count(options, phase), np.random.default_rng([options.seed, int(phase == "queries")]))


def _judged(robot: "Robot", goal: "Observation", result: "QueryResult") -> "QueryResult":
    """Return whether the robot is at the goal: by its true pose, else by a person, else by its own belief."""
    from ltvn_core.evaluation.query_run import judge_goal_reached

    truth: Pose | None = getattr(robot, "true_pose", None)
    if truth is not None and goal.exact_pose is not None:
        judged = judge_goal_reached(result.query, truth, goal.exact_pose)
        return replace(
            result,
            reached=judged.reached,
            judged_by="truth",
            position_error_m=judged.position_error_m,
            yaw_error_rad=judged.yaw_error_rad,
        )
    if sys.stdin.isatty():
        said = input("Does the robot stand within 0.72 m and 23 degrees of its goal? [y/n] ")
        return replace(result, reached=said.strip().lower().startswith("y"), judged_by="person")
    return replace(result, judged_by="belief")


def _summary(options: EvaluateRobotVerb, wall_s: float) -> RobotEvaluationSummary:
    results = _results(options)
    every = [result for phase in PHASES for result in results[phase]]
    return RobotEvaluationSummary(
        robot=options.robot,
        map=options.map,
        before=_share(results["before"]),
        queries=_share(results["queries"]),
        after=_share(results["after"]),
        judged_by=tuple(sorted({each.judged_by for each in every if each.judged_by is not None})),
        pruned=sum(each.pruned for each in every),
        added=sum(each.added_nodes + each.added_edges for each in every),
        driven_m=sum(each.path_m for each in every),
        folder=options.folder,
        wall_s=wall_s,
    )


def _share(results: "Sequence[QueryResult]") -> "SuccessRate":
    from ltvn_core.network.metrics import SuccessRate

    return SuccessRate.of(sum(each.reached for each in results), len(results))
