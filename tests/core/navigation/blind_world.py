"""A robot whose depth camera now and then finds nothing, and a predictor that must not meet such an image. No test."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ltvn_core.types import Depth, Features, Observation, Pose
from tests.core.flat_world import FlatPredictor, FlatRobot
from tests.core.navigation.mapped_world import MappedWorld

NO_DEPTH: dict[str, Depth | None] = {"zero": np.zeros((72, 96), np.float32), "absent": None}
"""The two ways in which an image has no depth."""


@dataclass
class DepthPredictor(FlatPredictor):
    """Needs depth, and says so by an error where an image without any comes in."""

    needs_depth: bool = True

    def encode(self, observations: Sequence[Observation]) -> Features:
        for seen in observations:
            assert seen.has_depth, f"image {seen.step} was encoded without depth"
        return super().encode(observations)


class BlindedRobot(FlatRobot):
    """Sees no depth from the poses that `blind` names."""

    blind: Callable[[Pose, int], bool]
    depth: Depth | None = None

    def observe(self) -> Observation:
        seen = super().observe()
        return replace(seen, depth=self.depth) if self.blind(self.pose, self.step) else seen


def blind_robot(place: MappedWorld, depth: Depth | None, blind: Callable[[Pose, int], bool]) -> MappedWorld:
    """Put a robot into the place that has `depth` where `blind` says so; the predictor there needs depth."""
    robot = BlindedRobot(place.world, place.robot.pose.tolist(), first_step=place.robot.step)
    robot.depth, robot.blind = depth, blind
    return replace(place, robot=robot, predictor=DepthPredictor(place.world))
