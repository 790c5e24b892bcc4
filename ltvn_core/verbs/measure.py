"""`ltvn measure`: measures the constants of Eq. 3 and Eq. 4, and the errors behind them, in simulated drives."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ltvn_core.training.held_out_scenes import TEST_SCENES
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import PredictorName
from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb

IMAGES_PER_SCENE = 150
"""Number of images of the drive through each scene; six scenes give more than a hundred thousand ordered pairs."""


@dataclass(frozen=True, kw_only=True)
class MeasureVerb(Verb):
    """Drive edges in simulation and measure the constants of Eq. 3 and Eq. 4; takes a few minutes."""

    job = "ltvn_core.verbs.jobs.measure:measure_driving"

    predictor: PredictorName = "network"
    """Predictor to measure: the trained network, or another by name."""
    weights: Path | None = None
    """Weights to measure instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings for driving and judging."""
    attempts: int = 200
    """Number of edges to drive in total: half of them exist and half do not, or fewer if the network is hard to
    mislead."""
    images: int = IMAGES_PER_SCENE
    """Number of images of the drive through each scene."""
    seed: int = 0
    """Seed of drives, edges, starts and odometry noise."""
    scenes: tuple[str, ...] = TEST_SCENES
    """Scenes to drive in; by default scenes that were not used to train or choose any weights."""
    body: BodyOption = "auto"
    folder: FilledFolder | None = None
    """Folder for the measurement of each scene, so that a stopped measurement can continue and parts can be
    combined.
    """
    part: str = ""
    """Only a share of the scenes, for arrays of jobs; 3/16 is the third of sixteen. The last part to finish sums up."""
    write: bool = False
    """Write the result into the weights' card, or into the file of the geometric predictor, so that the method uses
    it."""
