"""`ltvn judge`: measures the accuracy of a predictor on a recording with true poses."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class JudgeVerb(Verb):
    """Evaluate a predictor on a recording with true poses: on pairs of images, on a map, and on localisation in it."""

    job = "ltvn_core.verbs.jobs.judge:judge_predictor"

    recording: Positional[Path]
    """The recording; its images need true poses, which simulated and many imported recordings have."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; by default the better one for the recording's camera."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings, which decide when two images are joined."""
    against: Path | None = None
    """Another recording of the same place, with true poses in the same frame. The map is built from it, and the images
    of the first recording are localised in this map."""
    pairs: int = 20_000
    """Greatest number of far pairs to compare; the number of near pairs is an eighth of it."""
    images: int = 2000
    """Greatest number of images to read of a recording, evenly spaced."""
    part: str = "1/1"
    """Evaluate only on this part of the recording, for instance 2/2 for the second half; --against is used
    completely."""
    left_out: float = 0.2
    """Share of the images, evenly spaced, that are left out of the map and then localised in it."""
    without_truth: bool = False
    """Check only that the map is connected, which needs no true poses."""
    seed: int = 0
    """Seed of the pairs, the left-out images and the order of building."""
