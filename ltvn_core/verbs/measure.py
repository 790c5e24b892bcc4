"""`ltvn measure`: the constants of Eq. 3 and Eq. 4, and the errors behind them, from simulated drives."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ltvn_core.training.held_out_scenes import TEST_SCENES
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import PredictorName
from ltvn_core.verbs.verb import Verb

IMAGES_PER_SCENE = 150
"""Images of the drive through each scene: more than a hundred thousand ordered pairs in six."""


@dataclass(frozen=True, kw_only=True)
class MeasureVerb(Verb):
    """Drive edges in simulation and measure the constants of Eq. 3 and Eq. 4; takes a few minutes."""

    job = "ltvn_core.verbs.jobs.measure:measure_driving"

    predictor: PredictorName = "network"
    """Predictor to measure: the trained network, or another by name."""
    weights: Path | None = None
    """Weights to measure instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method that drives and judges."""
    attempts: int = 200
    """Edges to drive in all: half of them exist, half do not, or fewer where the network is hard to mislead."""
    images: int = IMAGES_PER_SCENE
    """Images of the drive through each scene."""
    seed: int = 0
    """Draws drives, edges, starts and odometry noise."""
    scenes: tuple[str, ...] = TEST_SCENES
    """Scenes to drive in; the default ones no weights have learned from or were chosen by."""
    body: BodyOption = "auto"
    folder: Path | None = None
    """Folder for the measurement of each scene, so that a stopped measurement can continue and parts can be
    combined.
    """
    part: str = ""
    """Only a share of the scenes, as 3/16 is the third of sixteen; for arrays of jobs. The last one sums up."""
    write: bool = False
    """Write the result into the weights' card, or beside the geometric predictor, from where the method takes its
    constants."""
