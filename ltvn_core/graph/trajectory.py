"""The images that a map is built from: which of them a predictor can compare, and what is wrong with them.

Owns these checks, which every builder runs first.
"""

import logging
from collections.abc import Collection, Sequence

import numpy as np

from ltvn_core.errors import MapError
from ltvn_core.types import FrameId, Observation, Pose, Predictor, is_usable

log = logging.getLogger(__name__)


def usable_trajectory(
    observations: Sequence[Observation], predictor: Predictor, goals: Collection[FrameId] = ()
) -> Sequence[Observation]:
    """Return the images of a trajectory that a predictor can compare, and log how many it cannot.

    Raises:
        MapError: The trajectory is empty, frame numbers repeat, or goals are not frames; or no image has the depth that
            the predictor needs, or a goal has none.
    """
    if not observations:
        raise MapError("The trajectory is empty; drive and record some images before building a map.")
    frames = [seen.step for seen in observations]
    if len(set(frames)) != len(frames):
        raise MapError("Frame numbers repeat in the trajectory; each image needs its own.")
    if unknown := set(goals) - set(frames):
        raise MapError(f"The goal frames {sorted(unknown)[:5]} are not in the trajectory.")
    usable = [seen for seen in observations if is_usable(seen, predictor)]
    if len(usable) == len(observations):
        return observations
    left_out = [seen.step for seen in observations if not is_usable(seen, predictor)]
    if not usable:
        raise MapError(
            f"None of the {len(observations)} images has depth, and the predictor needs it. Is the depth camera "
            "running? Drive again with it, or use a predictor that needs no depth."
        )
    if blind := sorted(set(goals) & set(left_out)):
        raise MapError(f"The goal frames {blind[:5]} have no depth, which the predictor needs; choose other goals.")
    log.warning(
        "%d of %d images have no depth (the first is frame %d); the map is built without them.",
        len(left_out),
        len(observations),
        left_out[0],
    )
    return usable


def odometry_of(observations: Sequence[Observation]) -> Pose:
    """Return the odometry (N, 3) of images."""
    return np.array([seen.odometry for seen in observations]).reshape(-1, 3)
