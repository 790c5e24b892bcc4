"""`ltvn finetune`: weights get to know the place of one recording (sections III-B and IV of the paper)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb, do_job


@dataclass(frozen=True, kw_only=True)
class FinetuneVerb(Verb):
    """Fine-tune weights on a robot's own drive; continues an interrupted call with the same output.

    The geometric predictor has no network: its calibration learns from the drive, in less than a minute.
    """

    recording: Positional[Path]
    """The recording of the drive, with odometry."""
    output: Path
    """The weights to write, with a card beside them; must not exist yet. For the geometric predictor a calibration, a
    .json file with its card in it."""
    predictor: Literal["network", "geometric"] = "network"
    """Predictor to train."""
    part: str = "1/1"
    """Learn from this stretch of the drive alone, for instance 1/2, the first half; `ltvn judge --part 2/2` then judges
    by the other."""
    horizon: int = 15
    """H: an image counts as reachable from the H images before it. Images closer than 0.1 m and 8
    degrees to the last one are left out first, so 15 images are about 1.5 m of straight driving."""
    literal: bool = False
    """Take the paper's rule as it is: all within the horizon are reachable, all others are not. Otherwise odometry and
    depth are checked as well, and uncertain pairs are left out.
    """
    weights: Path | None = None
    """Weights, or a calibration, to start from instead of the shipped ones; they are not changed."""
    data: Path | None = None
    """A folder of `ltvn dataset` to draw simulated pairs from; without one, a few scenes are rendered once."""
    minutes: float = 3.0
    """Time for training in minutes, without the evaluation."""
    seed: int = 0
    """Draws batches and augmentation."""

    def run(self) -> Summary:
        """Fine-tune, judge and save; raises OptionError, RecordingError, DatasetError and WeightsError."""
        if self.predictor == "network":
            return do_job("ltvn_core.verbs.jobs.finetune:finetune_network", self)
        return do_job("ltvn_core.verbs.jobs.tune_calibration:finetune_calibration", self)
