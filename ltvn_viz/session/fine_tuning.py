"""Fine-tuning of the network on the present environment: at most one at a time, in a separate thread.

Training takes minutes, and mapping and navigation continue meanwhile, so it has its own thread; it reads and writes
files of weights. Owns whether its result is offered.
`map_handlers` chooses the drive and switches to the new weights.

The remaining time is estimated from measurements on this computer: training takes the requested time; the parts before
and after it are measured. The final validation takes about as long as the first one, with calibration in between.
"""

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from ltvn_core.errors import OptionError
from ltvn_core.training.fine_tuning import FineTunedWeights
from ltvn_core.training.fine_tuning_data import DriveSource, ProgressReporter
from ltvn_viz.session.fine_tuner import FineTuningRequest
from ltvn_viz.session.job import Job, JobCancelled, Phase
from ltvn_viz.session.snapshot import FineTuningPhase, FineTuningStatus
from ltvn_viz.session.worker import Worker

JUDGING, LEARNING, CALIBRATING = "judging the weights before", "learning", "calibrating"
"""Names of the stages in `ltvn_core.network.optimization.fine_tuning_loop`."""
_MOST = 2.0
"""Largest ratio of two times: calibration and final validation together, to the first validation."""


class LearningTime:
    """The stages of one fine-tuning and when they began."""

    def __init__(self, minutes: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Start the timing of a fine-tuning that trains for `minutes`; `clock` counts seconds."""
        self._learning_s = 60 * minutes
        self._clock = clock
        self._began = clock()
        self._parts: dict[str, float] = {}

    def hear(self, doing: str) -> None:
        """Record the current stage."""
        self._parts.setdefault(doing, self._clock())

    @property
    def left(self) -> str:
        """Remaining time, in a few words."""
        if LEARNING not in self._parts:
            return f"more than {_minutes(self._learning_s)} left"
        judging_s = self._parts[LEARNING] - self._parts.get(JUDGING, self._parts[LEARNING])
        now = self._clock()
        learning_s = max(0.0, self._learning_s - (now - self._parts[LEARNING]))
        judged_s = now - self._parts.get(CALIBRATING, now)
        least, most = (learning_s + max(0.0, share * judging_s - judged_s) for share in (1.0, _MOST))
        return _range(least, most)

    @property
    def besides_s(self) -> float | None:
        """Time in seconds of all stages except training, once training is over; None before that."""
        return None if CALIBRATING not in self._parts else self._clock() - self._began - self._learning_s


def besides_words(besides_s: float | None) -> str:
    """Return a sentence about the extra time that fine-tuning takes beyond the requested time."""
    if besides_s is None:
        return "Preparation and evaluation add a few minutes; after the first run this page shows how many."
    return f"Preparation and evaluation took {_minutes(max(besides_s, 1.0))} more the last time."


def _range(least_s: float, most_s: float) -> str:
    low = math.ceil(least_s / 60)
    high = math.ceil(most_s / 60)
    if high <= 1:
        return "about a minute left"
    return f"about {high} min left" if low in (high, 0) else f"about {low} to {high} min left"


def _minutes(seconds: float) -> str:
    return f"{math.ceil(seconds / 60)} min"


Tune: TypeAlias = Callable[[FineTuningRequest, ProgressReporter, threading.Event], FineTunedWeights | None]
"""Fine-tunes; None if it was cancelled. Runs in the learning thread."""

FAR_FALSE_POSITIVE_RATE = "far_fpr_at_half"
WAYPOINT_ERROR = "position_median_m"
MAX_GROWTH, CHANCE_PAIRS = 1.25, 2.5
"""Limit of the new number of false links: the old number times this factor, plus this number of pairs."""
EVALUATION_SETS = {"own": "Here", "simulated": "Simulated"}


class FineTuning:
    """State of the fine-tuning of the weights in use."""

    def __init__(self, tune: Tune | None, weights: Path | None, executor: Executor) -> None:
        """Train `weights`, or the shipped ones for None; if `tune` is None, there is no network to train."""
        self._tune = tune
        self.weights = weights
        self._job = Job[FineTunedWeights](Worker(executor))
        self._status = FineTuningStatus(is_possible=tune is not None)
        self._told: tuple[float, str] = 0.0, ""
        self._time = LearningTime(0)
        self._offer: Path | None = None

    @property
    def status(self) -> FineTuningStatus:
        """The state for the page."""
        if self._status.phase is not FineTuningPhase.LEARNING:
            return self._status
        share, doing = self._told
        if self._job.cancelled.is_set():
            return replace(self._status, share=share, doing="stopping")
        return replace(self._status, share=share, doing=doing, left=self._time.left)

    @property
    def offer(self) -> Path:
        """New weights that can be put into use; raises OptionError if there are none."""
        if self._offer is None:
            raise OptionError("There are no new weights to use; press “Learn from this drive” first.")
        return self._offer

    def begin(self, drive: DriveSource, output: Path, minutes: float) -> None:
        """Start training on a drive; raises OptionError if there is no network, or if training is already running."""
        self.require_free()
        assert self._tune is not None
        tune = self._tune
        request = FineTuningRequest(drive, self.weights, output, minutes)
        self._offer = None
        self._told = (0.0, "beginning")
        self._time = LearningTime(minutes)
        self._become(FineTuningPhase.LEARNING, drive.name)
        self._job.begin("Learning", lambda _: self._learned(tune, request), self._ended)

    def require_free(self) -> None:
        """Raise OptionError if no training can start now."""
        if self._tune is None:
            raise OptionError(
                "Only the network can be trained, but another predictor is in use. Open the app with --predictor "
                "network."
            )
        if self._job.phase is Phase.RUNNING:
            raise OptionError("The network is learning already; wait for it, or stop learning first.")

    def cancel(self) -> None:
        """Cancel training at its next step: keep the weights in use and write none."""
        self._job.cancel()

    def dismiss(self) -> None:
        """Keep the weights in use; the new ones stay on disk."""
        self._offer = None
        self._become(FineTuningPhase.IDLE)

    def adopt(self, weights: Path) -> None:
        """Start the next training from these weights."""
        self.weights = weights
        self.dismiss()

    def collect(self) -> None:
        """Handle the result of a finished training."""
        self._job.collect()

    def close(self) -> None:
        """Cancel training and wait for the thread."""
        self._job.close()

    def _tell(self, share: float, doing: str) -> None:
        self._told = share, doing
        self._time.hear(doing)

    def _learned(self, tune: Tune, request: FineTuningRequest) -> FineTunedWeights:
        if (found := tune(request, self._tell, self._job.cancelled)) is None:
            raise JobCancelled
        return found

    def _ended(self) -> None:
        name = self._status.drive
        self._status = replace(self._status, besides_s=self._time.besides_s or self._status.besides_s)
        if (result := self._job.result) is not None:
            worse = far_false_positives_grew(result)
            self._offer = None if worse else result.weights
            phase = FineTuningPhase.WORSE if worse else FineTuningPhase.LEARNED
            self._become(phase, name, result_lines(result), str(result.weights))
        elif self._job.phase is Phase.FAILED:
            self._become(FineTuningPhase.FAILED, name, (self._job.reason,))
        else:
            self._become(FineTuningPhase.IDLE, name, ("Stopped; the network is as it was.",))

    def _become(self, phase: FineTuningPhase, drive: str = "", lines: tuple[str, ...] = (), path: str = "") -> None:
        self._status = replace(self._status, phase=phase, drive=drive, lines=lines, path=path)


def far_false_positives_grew(learned: FineTunedWeights) -> bool:
    """Tell whether more far pairs are predicted reachable than before, in the present environment or in simulation."""
    return any(
        _grew(learned, place) for place in EVALUATION_SETS if f"{place}_{FAR_FALSE_POSITIVE_RATE}" in learned.before
    )


def result_lines(learned: FineTunedWeights) -> tuple[str, ...]:
    """Return one line for each evaluation set, with the metrics before and after."""
    return tuple(_line(label, place, learned) for place, label in EVALUATION_SETS.items())


def _grew(learned: FineTunedWeights, place: str) -> bool:
    before = learned.before[f"{place}_{FAR_FALSE_POSITIVE_RATE}"]
    after = learned.after[f"{place}_{FAR_FALSE_POSITIVE_RATE}"]
    return after > MAX_GROWTH * before + CHANCE_PAIRS / max(learned.after[f"{place}_far_pairs"], 1)


def _line(label: str, place: str, learned: FineTunedWeights) -> str:
    parts = []
    for name, key, factor, digits, unit in (
        ("false links", f"{place}_{FAR_FALSE_POSITIVE_RATE}", 100.0, 2, "%"),
        ("waypoint error", f"{place}_{WAYPOINT_ERROR}", 100.0, 1, "cm"),
    ):
        before = learned.before.get(key)
        after = learned.after.get(key)
        if before is not None and after is not None and before == before and after == after:  # NaN means undefined
            parts.append(f"{name} {factor * before:.{digits}f} → {factor * after:.{digits}f} {unit}")
    return f"{label}: {', '.join(parts) or 'nothing to evaluate'}."
