"""A drive through a flat world, ready to be judged, and predictors that answer in known ways."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import ROBUST
from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence
from ltvn_core.evaluation.predictor_accuracy.judgement import Judgement, JudgementPlan, judge
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training.drive_path import true_views
from ltvn_core.types import Features, Observation, Pose, Prediction, Predictor
from tests.core.flat_world import FlatPredictor, one_room, tour

CORNERS = ([0.8, 0.8], [4.2, 0.8], [4.2, 3.2], [0.8, 3.2], [0.8, 0.8])


def drive() -> tuple[Observation, ...]:
    """Return the images of one round through a room of 5 m x 4 m."""
    return tuple(tour(CORNERS, spins=False))


def sequence(observations: Sequence[Observation], poses: Pose | None = None) -> JudgedSequence:
    """Return observations with their own true poses, or with others."""
    truly = list(observations)
    if poses is not None:
        truly = [replace(seen, exact_pose=pose) for seen, pose in zip(observations, poses, strict=True)]
    views = true_views(truly, [LOCOBOT.camera] * len(truly))
    return JudgedSequence(
        path=Path("drive.rrd"),
        observations=tuple(observations),
        views=views,
        without_truth=0,
        without_depth=0,
        skipped=0,
    )


def knowing_predictor() -> FlatPredictor:
    """Return a predictor that knows the room."""
    return FlatPredictor(one_room())


@dataclass
class ConstantPredictor:
    """Says the same of every pair. Features are empty."""

    reachability: float = 0.9
    waypoint: tuple[float, float, float] = (0.3, 0.0, 0.0)
    fingerprint: str = "constant"
    camera: CameraModel = LOCOBOT.camera

    def encode(self, observations: Sequence[Observation]) -> Features:
        return np.zeros((len(observations), 1))

    def predict(self, sources: Features, targets: Features) -> Prediction:
        return Prediction(np.full(len(targets), self.reachability), np.tile(self.waypoint, (len(targets), 1)))


@dataclass
class ShiftedPredictor:
    """Finds every place where it is, but 30 cm farther ahead. Features are exact poses (N, 3)."""

    ahead_m: float = 0.3
    fingerprint: str = "shifted"
    camera: CameraModel = LOCOBOT.camera

    def encode(self, observations: Sequence[Observation]) -> Features:
        return np.array([seen.exact_pose for seen in observations if seen.exact_pose is not None])

    def predict(self, sources: Features, targets: Features) -> Prediction:
        there = np.asarray(targets, np.float64)
        true = relative(np.broadcast_to(np.asarray(sources, np.float64), there.shape), there)
        near = (np.hypot(true[:, 0], true[:, 1]) < 0.65) & (np.abs(true[:, 2]) < 0.4)
        ahead = np.broadcast_to(np.array([self.ahead_m, 0.0, 0.0]), true.shape)
        return Prediction(np.where(near, 0.95, 0.05), compose(true, ahead))


@contextmanager
def no_bar(step: str, total: int, unit: str) -> Iterator[Callable[[int], object]]:
    """Show nothing."""
    yield lambda done: None


def judged(
    looking: JudgedSequence,
    mapped: JudgedSequence,
    predictor: Predictor,
    plan: JudgementPlan = JudgementPlan(),  # noqa: B008
) -> Judgement:
    """Judge with the usual settings."""
    return judge(looking, mapped, predictor=predictor, system=ltvn_system(ROBUST), plan=plan, bars=no_bar)
