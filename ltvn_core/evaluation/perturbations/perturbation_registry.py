"""The table of perturbations by the names that the command line knows."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.perturbations.colour_perturbations import (
    Flare,
    MotionBlur,
    SensorNoise,
    StrongCompression,
    WrongExposure,
    WrongWhiteBalance,
)
from ltvn_core.evaluation.perturbations.geometry_perturbations import DepthHoles, OtherLens
from ltvn_core.types import Observation

DROPPED_FRAMES = "dropped-frames"
"""Not a change of one image, so not in the table: `FrameLoss` draws which frames never arrive."""
ALL = "all"


class Perturbation(Protocol):
    """Makes one observation worse."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return a worse observation of the same size; the one that comes in stays as it is."""
        ...


_TABLE: Mapping[str, Callable[[CameraModel], Perturbation]] = {
    "blur": MotionBlur,
    "exposure": lambda camera: WrongExposure(),
    "flare": Flare,
    "depth-holes": lambda camera: DepthHoles(),
    "lens": OtherLens,
    "noise": lambda camera: SensorNoise(),
    "white-balance": lambda camera: WrongWhiteBalance(),
    "jpeg": lambda camera: StrongCompression(),
}

PERTURBATIONS = (*_TABLE, DROPPED_FRAMES)
"""All names."""


def chosen_perturbations(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of perturbations, each once; `all` stands for every one.

    Raises OptionError for a name that is none.
    """
    chosen = tuple(dict.fromkeys(names))
    if chosen == (ALL,):
        return PERTURBATIONS
    if unknown := [name for name in chosen if name not in PERTURBATIONS]:
        raise OptionError(
            f"--perturb does not know {', '.join(unknown)}; name one or several of {' '.join(PERTURBATIONS)}, "
            f"separated by spaces, or {ALL}."
        )
    return chosen


def open_perturbation(name: str, camera: CameraModel) -> Perturbation:
    """Return a perturbation of images of a camera; `name` is one of `PERTURBATIONS` but not `DROPPED_FRAMES`."""
    return _TABLE[name](camera)


def perturb_all(observations: Sequence[Observation], perturbation: Perturbation, *, seed: int) -> list[Observation]:
    """Return worse observations; what happens to an image depends on the seed and on its step alone."""
    return [perturbation(seen, np.random.default_rng([seed, abs(seen.step)])) for seen in observations]
