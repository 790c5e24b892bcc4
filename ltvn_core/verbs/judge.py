"""`ltvn judge`: how good a predictor is on a recording whose true poses are known."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class JudgeVerb(Verb):
    """Judge a predictor on a recording with true poses: pairs of images, a map, finding one's place in it."""

    job = "ltvn_core.verbs.jobs.judge:judge_predictor"

    recording: Positional[Path]
    """The recording; its images need true poses, as simulated and imported recordings have them."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; by default the better one for the recording's camera."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings, which say when two images are joined."""
    against: Path | None = None
    """Another recording of the same place, with true poses in the same frame: the map is built from that one, and the
    images of the first look for those of the second."""
    pairs: int = 20_000
    """Far pairs to compare at most, and an eighth as many near pairs."""
    images: int = 2000
    """Images to read of a recording at most, evenly spaced."""
    part: str = "1/1"
    """Judge by this stretch of the recording alone, for instance 2/2, the second half; --against is taken whole."""
    left_out: float = 0.2
    """Share of the images, evenly spaced, that the map is not built from, and that are then looked for in it."""
    perturb: tuple[str, ...] = ()
    """Perturbations of the query images, one after the other: one or several of blur, exposure, flare, depth-holes,
    lens, noise, white-balance, jpeg, dropped-frames, or all."""
    without_truth: bool = False
    """Judge only whether the map hangs together, which needs no true poses."""
    revisits: Path | None = None
    """A matrix of loop closures, a row and a column per image, as text or as a picture: measures how well places are
    recognised again. No true poses are needed then."""
    report: Path | None = None
    """A page (.html) to write, with pictures of the worst pairs."""
    worst: int = 12
    """Pairs of each kind to show on that page at most."""
    seed: int = 0
    """Draws pairs, the images left out, the order of building, and perturbations."""
