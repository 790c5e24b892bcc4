"""How long it takes to correct a long drive by its loop closures, of which a third is false."""

import numpy as np

from benchmarks.measurement import Measurement, measured, seconds_once
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.pose_graph import RelativePoses, optimise
from ltvn_core.types import Pose

POSES, TRUE, FALSE = 6_000, 1_100, 600
LAPS = 6
_STEP_M = 0.12
_ODOMETRY_DEVIATION, _CLOSURE_DEVIATION = 0.02, 0.1
_ODOMETRY_NOISE, _CLOSURE_NOISE = (0.005, 0.002, 0.003), 0.05


def winding_laps(poses: int, rng: np.random.Generator) -> Pose:
    """Return poses (N, 3) of equal laps along one winding way, which ends where it began in direction."""
    lap = poses // LAPS
    turns = rng.normal(0, 0.12, lap)
    turns += (2 * np.pi - turns.sum()) / lap
    way = [np.zeros(3)]
    for turn in turns[1:]:
        way.append(compose(way[-1], np.array([_STEP_M, 0.0, turn])))
    return np.tile(way, (LAPS, 1))


def closures_of(truth: Pose, true: int, false: int, rng: np.random.Generator) -> RelativePoses:
    """Return true closures between laps, and false ones that say that any two places are the same."""
    poses = len(truth)
    lap = poses // LAPS
    again = rng.integers(lap, poses, true)
    before = again % lap
    seen = relative(truth[again], truth[before]) + rng.normal(0, _CLOSURE_NOISE, (true, 3))
    mistaken = rng.integers(poses, size=(2, false))
    first, second = np.concatenate([[again, before], mistaken], axis=1)
    gaps = np.concatenate([seen, rng.normal(0, 0.4, (false, 3))])
    return RelativePoses(first, second, gaps, np.full((true + false, 3), _CLOSURE_DEVIATION))


def correct_long_drive() -> list[Measurement]:
    """Time the correction of 6,000 poses by 1,700 closures."""
    spent_s = correction_s(POSES, TRUE, FALSE)
    return [measured(f"correct {POSES:,} poses by {TRUE + FALSE:,} closures, {FALSE} false", spent_s, "s", at_most=10)]


def correction_s(poses: int, true: int, false: int) -> float:
    """Return the time in seconds to correct a drive by a number of true and false closures."""
    rng = np.random.default_rng(0)
    truth = winding_laps(poses, rng)
    steps = relative(truth[:-1], truth[1:]) + rng.normal(0, 1, (len(truth) - 1, 3)) * _ODOMETRY_NOISE
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    rows = np.arange(len(truth) - 1)
    chain = RelativePoses(rows, rows + 1, steps, np.full((len(truth) - 1, 3), _ODOMETRY_DEVIATION))
    closures = closures_of(truth, true, false, rng)
    return seconds_once(lambda: optimise(np.array(odometry), chain, closures))
