"""A short drive through the box world, seen by a robot whose odometry is what a test says it is."""

from collections.abc import Sequence

import numpy as np

from ltvn_core.network.training_data.shards import render_poses
from ltvn_core.types import Observation, Pose
from tests.core.network.training_data.box_world import two_rooms


def poses_along(*points: tuple[float, float], step_m: float = 0.12, step_rad: float = 0.17) -> Pose:
    """Return poses (N, 3) that drive straight from point to point and turn on the spot in between."""
    pose = np.array([*points[0], np.arctan2(points[1][1] - points[0][1], points[1][0] - points[0][0])])
    poses = [pose.copy()]
    for point in points[1:]:
        segment = np.array(point) - pose[:2]
        turn = np.angle(np.exp(1j * (np.arctan2(segment[1], segment[0]) - pose[2])))
        poses += [pose + np.array([0, 0, part]) for part in _parts(turn, step_rad)]
        pose = np.array([*pose[:2], pose[2] + turn])
        poses += [
            pose + np.array([*(segment * part / np.hypot(*segment)), 0])
            for part in _parts(float(np.hypot(*segment)), step_m)
        ]
        pose = np.array([*point, pose[2]])
    return np.array(poses)


def poses_turning(x: float, y: float, turns: float = 1.0, step_rad: float = 0.17) -> Pose:
    """Return poses (N, 3) of turning on the spot."""
    yaws = np.arange(0, 2 * np.pi * turns, step_rad)
    return np.column_stack([np.full(len(yaws), x), np.full(len(yaws), y), yaws])


def observations_at(
    poses: Pose, odometry: Pose | None = None, exact: Sequence[Pose | None] | None = None
) -> list[Observation]:
    """Return what the robot sees at its true poses (N, 3); odometry is true unless given."""
    rgb, depth_mm = render_poses(two_rooms().camera, poses)
    odometry = poses if odometry is None else odometry
    exact = exact or [None] * len(poses)
    return [
        Observation(rgb[k], depth_mm[k] / np.float32(1000), odometry[k], 0.1 * k, k, exact[k])
        for k in range(len(poses))
    ]


def _parts(whole: float, step: float) -> np.ndarray:
    count = int(np.ceil(abs(whole) / step))
    return whole * np.arange(1, count + 1) / max(count, 1)
