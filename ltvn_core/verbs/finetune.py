"""`ltvn finetune`: adapts weights to the place of one recording (sections III-B and IV of the paper)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.outputs import NewWeights
from ltvn_core.verbs.verb import Summary, Verb, do_job


@dataclass(frozen=True, kw_only=True)
class FinetuneVerb(Verb):
    """Fine-tune weights on a robot's own drive; continues an interrupted call with the same output.

    The geometric predictor has no network. Its calibration is fitted to the drive in less than a minute.
    """

    recording: Positional[Path]
    """The recording of the drive, with odometry."""
    output: NewWeights
    """The weights to write, with a card beside them; must not exist yet. For the geometric predictor, a .json file with
    the calibration and its card."""
    predictor: Literal["network", "geometric"] = "network"
    """Predictor to train."""
    part: str = "1/1"
    """Learn only from this part of the drive, for instance 1/2 for the first half; `ltvn judge --part 2/2` then tests
    on the other half."""
    horizon: int = 15
    """H: an image counts as reachable from the H images before it. First, images closer than 0.1 m and 8 degrees to the
    previous one are left out, so that 15 images are about 1.5 m of straight driving."""
    literal: bool = False
    """Use the paper's rule without changes: all pairs within the horizon are reachable, all others are not. By default,
    odometry and depth are checked as well, and uncertain pairs are left out."""
    weights: Path | None = None
    """Weights or calibration to start from instead of the shipped ones; the file is not changed."""
    data: Path | None = None
    """A folder of `ltvn dataset` with simulated pairs; by default, a few scenes are rendered once."""
    minutes: float = 3.0
    """Time for training in minutes, without the evaluation."""
    seed: int = 0
    """Seed of batches and augmentation."""

    def run(self) -> Summary:
        """Fine-tune, evaluate and save; raises OptionError, RecordingError, DatasetError and WeightsError."""
        if self.predictor == "network":
            return do_job("ltvn_core.verbs.jobs.finetune:finetune_network", self)
        return do_job("ltvn_core.verbs.jobs.tune_calibration:finetune_calibration", self)
