"""`ltvn evaluate-robot`: the paper's test on a robot (its Table II): episodes, queries with maintenance, episodes.

Each result is on disk before the next episode begins, so that a run that was ended, or lost its robot, goes on where it
was. Owns the order, the goals and who judges.
"""

import json
import logging
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import cattrs
import numpy as np
from scipy.stats import binomtest

from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.navigation.episode import judge_goal_reached
from ltvn_core.navigation.events import Outcome
from ltvn_core.navigation.lifelong_run import random_goals
from ltvn_core.recording.map_file import load_map
from ltvn_core.recording.run_description import RunDescription
from ltvn_core.robots.continued_robot import ContinuedRobot
from ltvn_core.robots.rectified_robot import fit_camera
from ltvn_core.robots.robot import Robot
from ltvn_core.structured_text import parse_json
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.types import NodeId, Observation, Pose
from ltvn_core.verbs.evaluate_robot import EvaluateRobotVerb
from ltvn_core.verbs.jobs.robot_queries import QueryResult, RobotQueries, opened_robot
from ltvn_core.verbs.navigate_options import NavigateOptions

_LOG = logging.getLogger(__name__)

Phase = Literal["before", "queries", "after"]
PHASES: tuple[Phase, ...] = get_args(Phase)


@dataclass(frozen=True)
class RobotEpisode:
    """One episode or query, as its line in `episodes.jsonl` has it."""

    phase: Phase
    number: int
    """Counts within the phase."""
    goal: NodeId
    outcome: str
    """How it ended, as the robot sees it; "gone" where the map had lost the goal."""
    reached: bool
    judged_by: str
    """Who says so: truth (the robot's true pose, within 0.72 m and 0.4 rad), person, or belief (the robot itself)."""
    away_m: float | None
    """Distance from the goal at the end, where the truth is known."""
    path_m: float
    seconds: float
    pruned: int
    added: int


@dataclass(frozen=True)
class ReachedShare:
    """How many of some episodes reached their goal."""

    episodes: int
    reached: int
    rate: float
    low: float
    """95 % interval (Wilson)."""
    high: float


@dataclass(frozen=True)
class RobotEvaluationSummary:
    """What a robot reached before and after it learned from queries."""

    robot: str
    map: Path
    before: ReachedShare
    queries: ReachedShare
    after: ReachedShare
    judged_by: tuple[str, ...]
    """Who said what was reached: truth, person or belief."""
    pruned: int
    """Edges that the queries took away."""
    added: int
    """Nodes and edges that they brought in."""
    driven_m: float
    folder: Path
    """Holds episodes.jsonl, the recordings and the maps; called again, the verb goes on from there."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class RobotEvaluation:
    """What to test."""

    robot: str
    map: NavigateOptions
    """The map to begin with, and what drives by it."""
    episodes: int
    """Before, and again after the queries."""
    queries: int
    folder: Path

    def count(self, phase: Phase) -> int:
        """Return how many episodes a phase has."""
        return self.queries if phase == "queries" else self.episodes


def test_robot(options: EvaluateRobotVerb) -> RobotEvaluationSummary:
    """Run what is not done yet. Raises RobotError where the robot is lost, MapError, RecordingError, OptionError."""
    if options.episodes < 1 or options.queries < 0:
        raise OptionError("--episodes must be 1 or more, and --queries 0 or more.")
    drive = NavigateOptions(
        map=options.map,
        recording=options.folder,
        preset=options.preset,
        predictor=options.predictor,
        weights=options.weights,
        seed=options.seed,
    )
    test = RobotEvaluation(
        robot=options.robot, map=drive, episodes=options.episodes, queries=options.queries, folder=options.folder
    )
    return evaluate_robot(test)


def evaluate_robot(test: RobotEvaluation) -> RobotEvaluationSummary:
    """Run what is not done yet. Raises RobotError where the robot is lost, MapError, RecordingError, OptionError."""
    begun_s = time.monotonic()
    test.folder.mkdir(parents=True, exist_ok=True)
    log = _EpisodeLog(test.folder / "episodes.jsonl")
    with opened_robot(test.robot) as own:
        for phase in PHASES:
            if len(log.of(phase)) < test.count(phase):
                _run_phase(test, phase, own, log)
    return _summary(test, log, time.monotonic() - begun_s)


def _run_phase(test: RobotEvaluation, phase: Phase, own: Robot, log: "_EpisodeLog") -> None:
    """Run what is left of a phase; what a query teaches is saved before its result is."""
    done, count, goals = len(log.of(phase)), test.count(phase), _goals(test, phase)
    learned = test.folder / f"map-{done if phase == 'queries' else test.queries}.rrd"
    opened = replace(test.map, map=learned if phase != "before" and learned.exists() else test.map.map).open_map()
    loaded, predictor, predictor_name, system, keyframes = opened
    if phase != "queries":
        system = with_maintenance(system, "static")
    newest = max(loaded.observations.values(), key=lambda each: each.step)
    robot = ContinuedRobot(fit_camera(own, predictor.camera), last_step=newest.step, last_stamp_s=newest.stamp)
    run = RunDescription(
        scene=loaded.meta.scene,
        config={**test.map.settings(system, predictor_name), "verb": "evaluate", "robot": test.robot, "phase": phase},
        fingerprint=predictor.fingerprint,
        camera=robot.spec.camera,
        scene_glb=loaded.scene_glb,
    )
    rng = np.random.default_rng([test.map.seed, PHASES.index(phase), done])
    with run.open_writer(test.folder / time.strftime(f"{phase}-{done}-%Y%m%d-%H%M%S.rrd")) as writer:
        writer.write_map(loaded.graph, loaded.observations.values())
        driver = RobotQueries(robot, writer, loaded.graph, keyframes, predictor, system, rng)
        for number in range(done, count):
            goal, begun_s = goals[number], time.monotonic()
            result = driver.drive_to(goal, number) if goal in loaded.graph.nodes else None
            verdict = _verdict(own, keyframes.observation(goal), result)
            if phase == "queries":
                images = [keyframes.observation(frame) for frame in loaded.graph.frames]
                run.save_map(test.folder / f"map-{number + 1}.rrd", loaded.graph, images, origin=test.map.map)
                (test.folder / f"map-{number}.rrd").unlink(missing_ok=True)
            log.add(_episode(phase, number, goal, result, verdict, time.monotonic() - begun_s))
            _LOG.info("%s, %d of %d: %s", phase, number + 1, count, "reached" if verdict.reached else "not reached")


def _goals(test: RobotEvaluation, phase: Phase) -> Sequence[NodeId]:
    """Return the goals of a phase, nodes of the map as it was; before and after they are the same."""
    nodes = sorted(load_map(test.map.map).graph.nodes)
    return random_goals(nodes, test.count(phase), np.random.default_rng([test.map.seed, int(phase == "queries")]))


class _Verdict(NamedTuple):
    reached: bool
    judged_by: str
    away_m: float | None = None


def _verdict(robot: Robot, goal: Observation, result: QueryResult | None) -> _Verdict:
    """Judge where the robot stands: by its true pose, else by a person, else by what it believes."""
    if result is None:
        return _Verdict(False, "belief")
    truth: Pose | None = getattr(robot, "true_pose", None)
    if truth is not None and goal.exact_pose is not None:
        judged = judge_goal_reached(0, truth, goal.exact_pose)
        return _Verdict(judged.reached, "truth", judged.position_error_m)
    if sys.stdin.isatty():
        said = input("Does the robot stand within 0.72 m and 23 degrees of its goal? [y/n] ")
        return _Verdict(said.strip().lower().startswith("y"), "person")
    return _Verdict(result.ended.outcome is Outcome.ARRIVED, "belief")


def _episode(
    phase: Phase, number: int, goal: NodeId, result: QueryResult | None, verdict: _Verdict, seconds: float
) -> RobotEpisode:
    return RobotEpisode(
        phase=phase,
        number=number,
        goal=goal,
        outcome="gone" if result is None else str(result.ended.outcome),
        **verdict._asdict(),
        path_m=0.0 if result is None else result.ended.path_m,
        seconds=seconds,
        pruned=0 if result is None else result.pruned,
        added=0 if result is None else result.added,
    )


def _summary(test: RobotEvaluation, log: "_EpisodeLog", wall_s: float) -> RobotEvaluationSummary:
    before, queries, after = (_share(log.of(phase)) for phase in PHASES)
    return RobotEvaluationSummary(
        robot=test.robot,
        map=test.map.map,
        before=before,
        queries=queries,
        after=after,
        judged_by=tuple(sorted({each.judged_by for each in log.episodes})),
        pruned=sum(each.pruned for each in log.episodes),
        added=sum(each.added for each in log.episodes),
        driven_m=sum(each.path_m for each in log.episodes),
        folder=test.folder,
        wall_s=wall_s,
    )


def _share(episodes: Sequence[RobotEpisode]) -> ReachedShare:
    count, reached = len(episodes), sum(each.reached for each in episodes)
    if not count:
        return ReachedShare(0, 0, 0.0, 0.0, 1.0)
    low, high = binomtest(reached, count).proportion_ci(method="wilson")
    return ReachedShare(count, reached, reached / count, float(low), float(high))


class _EpisodeLog:
    """The lines of `episodes.jsonl`."""

    def __init__(self, path: Path) -> None:
        """Read what is there. Raises RecordingError where a line is no episode."""
        self.episodes: list[RobotEpisode] = []
        self._path = path
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
            try:
                self.episodes.append(cattrs.structure(parse_json(line), RobotEpisode))
            except (ValueError, KeyError, cattrs.BaseValidationError) as error:
                raise RecordingError(f"{path} has a line that is no episode: {line:.60!r}; remove it.") from error

    def of(self, phase: Phase) -> list[RobotEpisode]:
        return [each for each in self.episodes if each.phase == phase]

    def add(self, episode: RobotEpisode) -> None:
        self.episodes.append(episode)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(episode)) + "\n")
            file.flush()
            os.fsync(file.fileno())
