"""`python -m benchmarks.arrivals`: is the robot where it says it has arrived, at goals whose images show little?

Goals are the images of a map that show the least texture, as in front of a bare wall, and those that resemble the most
images of other places. It goes on from what its folder holds. Owns the scenes, none of which is a test scene, the
choice of goals, and the table.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ltvn_core.evaluation.episode_runner import EpisodeRunner
    from ltvn_core.evaluation.plans import RunPlan
    from ltvn_core.evaluation.preparation import DriveGroundTruth
    from ltvn_core.evaluation.protocol import EpisodePlan
    from ltvn_core.evaluation.query_result import QueryResult
    from ltvn_core.types import NodeId

SCENES: Mapping[str, tuple[str, ...]] = {
    "tune-0": (),
    "tune-plain-0": ("one-loop",),
    "tune-plain-1": ("one-loop",),
    "tune-twin-0": ("one-loop",),
    "tune-office-0": ("one-loop",),
    "tune-plain-2": ("one-loop",),
    "tune-plain-3": ("one-loop",),
    "tune-office-1": ("one-loop",),
}
"""Scene -> what is harder there than usual. Thresholds were chosen on the first five only."""
REACHED_M = 0.72
"""Distance from the goal within which it counts as reached, in metres (paper)."""
_APART_M, _ELSEWHERE_M = 1.0, 2.0
"""Least distance between two goals, and from an image to one that it merely resembles, in metres."""
_RESEMBLES = 0.5


@dataclass(frozen=True)
class SceneArrivals:
    """The episodes of one scene."""

    scene: str
    episodes: int
    arrived: int
    """Number of episodes that the robot ended by saying that it has arrived."""
    reached: int
    """Number of those in which it had, by the paper's criterion."""
    wrong: int
    """Number of those in which it was farther than `REACHED_M` from the goal."""
    worst_m: float
    """Largest distance from the goal at an arrival, in metres."""
    spl: float
    collisions: float
    """Per episode."""


@dataclass(frozen=True)
class ArrivalsSummary:
    """All scenes that are done."""

    scenes: list[SceneArrivals]
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class ArrivalsVerb(Verb):
    """Drive to goals whose images show little, and count the arrivals elsewhere; resumable."""

    scene: tuple[str, ...] = tuple(SCENES)
    """Scenes by name."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 25
    """Episodes for each scene."""
    goals: Annotated[int, tyro.conf.arg(metavar="N")] = 12
    """Goals for each scene: half of them with little texture, the others with many images that they resemble."""
    folder: Path = Path("runs/arrivals")
    """Where drives, weights, maps and results are kept, and found again by the next call."""

    def run(self) -> Summary:
        """Run what is missing, scene after scene, and sum up."""
        started = time.monotonic()
        scenes = [summed_up(scene, self._results(scene)) for scene in self.scene]
        return ArrivalsSummary(scenes, round(time.monotonic() - started, 1))

    def _results(self, scene: str) -> "list[QueryResult]":
        from tqdm import tqdm

        from ltvn_core.evaluation.episode_runner import episode_rng, open_runner
        from ltvn_core.evaluation.plans import RunFiles
        from ltvn_core.evaluation.preparation import prepare
        from ltvn_core.evaluation.query_result import append_to_log, read_query_log

        plan = self._plan(scene)
        files = RunFiles.of(plan, self.folder)
        log = files.folder / f"arrivals-{self.goals}.jsonl"
        done = read_query_log(log)
        if len(done) >= self.episodes:
            return done[: self.episodes]
        truth = prepare(files)
        runner = open_runner(files)
        goals = hard_goals(runner, truth, self.goals)
        for number in tqdm(range(len(done), self.episodes), desc=scene, unit="episode"):
            episode = draw_episode(truth, goals[number % len(goals)], np.random.default_rng([plan.seed, 5, number]))
            append_to_log(log, runner.run(number, episode, episode_rng(plan.seed, number)))
        return read_query_log(log)

    def _plan(self, scene: str) -> "RunPlan":
        from ltvn_core.evaluation.plans import RunPlan
        from ltvn_core.evaluation.protocol import EvaluationProtocol, protocol_under
        from ltvn_core.simulation.body_selection import choose_body

        conditions = SCENES.get(scene, ())
        protocol = protocol_under(EvaluationProtocol(episodes=self.episodes, body=choose_body("planar")), conditions)
        return RunPlan(scene=scene, seed=0, conditions=conditions, protocol=protocol)


def hard_goals(runner: "EpisodeRunner", truth: "DriveGroundTruth", count: int) -> "list[NodeId]":
    """Return nodes whose images show little: in turn one with little texture, and one that resembles other places."""
    poses = dict(zip(truth.frames, np.array(truth.poses), strict=True))
    nodes = [node for node in runner.map.graph.nodes if node in poses]
    places = np.array([poses[node] for node in nodes])
    features = runner.map.keyframes.features(nodes)
    texture = [_texture(runner.map.keyframes.observation(node).rgb) for node in nodes]
    alike = np.zeros(len(nodes))
    for k in range(len(nodes)):
        found = runner.map.predictor.predict(features[[k]], features)
        elsewhere = np.hypot(*(places - places[k])[:, :2].T) > _ELSEWHERE_M
        alike[k] = (found.reachability[elsewhere] > _RESEMBLES).sum()
    orders = np.argsort(texture, kind="stable").tolist(), np.argsort(-alike, kind="stable").tolist()
    chosen = list[int]()
    while len(chosen) < count and any(orders):
        order = orders[len(chosen) % 2] or orders[1 - len(chosen) % 2]
        k = order.pop(0)
        if all(np.hypot(*(places[k] - places[other])[:2]) > _APART_M for other in chosen):
            chosen.append(k)
    return [nodes[k] for k in chosen]


def _texture(rgb: "NDArray[np.uint8]") -> float:
    """Return the mean absolute difference between neighbouring pixels of an image (H, W, 3)."""
    gray = rgb.astype(np.float64).mean(axis=-1)
    return float(np.abs(np.diff(gray, axis=0)).mean() + np.abs(np.diff(gray, axis=1)).mean())


def draw_episode(truth: "DriveGroundTruth", goal: "NodeId", rng: np.random.Generator) -> "EpisodePlan":
    """Draw an episode from a random image of the drive, at another place, to a goal."""
    from ltvn_core.evaluation.protocol import draw_episodes

    return draw_episodes(truth.frames, np.array(truth.poses), [goal], 1, rng)[0]


def summed_up(scene: str, results: "Sequence[QueryResult]") -> SceneArrivals:
    """Return what the episodes of a scene came to."""
    from ltvn_core.navigation.events import Outcome

    gaps_m = [each.position_error_m or 0.0 for each in results if each.outcome == Outcome.ARRIVED]
    return SceneArrivals(
        scene=scene,
        episodes=len(results),
        arrived=len(gaps_m),
        reached=sum(each.reached for each in results),
        wrong=sum(gap_m > REACHED_M for gap_m in gaps_m),
        worst_m=round(max(gaps_m, default=0.0), 2),
        spl=round(float(np.mean([each.spl for each in results])), 3),
        collisions=round(float(np.mean([each.collisions for each in results])), 2),
    )


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.arrivals", ArrivalsVerb))
