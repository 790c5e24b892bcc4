"""Progress of long tests: a progress bar, and a summary if other parts are unfinished.

`ltvn evaluate` and `ltvn lifelong` use this bar: first for the preparation of the maps, then for the episodes or
queries.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from tqdm import tqdm

from ltvn_core.evaluation.preparation_progress import EvaluationProgress


@dataclass(frozen=True)
class PartSummary:
    """Results of one part of a test, while other parts are unfinished."""

    part: str
    done: int
    """Number of episodes, queries or scenes in this part."""
    tests: int
    """Number of tests in all parts: one for each scene, seed and maintenance."""
    finished: int
    """Number of tests in all parts that are complete."""
    folder: Path
    """Folder that all parts share."""
    wall_s: float


def progress_on_bar(bar: "tqdm[NoReturn]", maps: int) -> EvaluationProgress:
    """Return the progress callbacks for a bar, which first shows the preparation of `maps` maps."""
    shown = _PreparationOnBar(bar, maps)
    return EvaluationProgress(
        maps_ready=shown.maps_ready, work_done=bar.update, preparing=shown.preparing, unfinished=shown.unfinished
    )


class _PreparationOnBar:
    """Shows the preparation of the maps on a bar, and then resets the bar for the work."""

    def __init__(self, bar: "tqdm[NoReturn]", maps: int) -> None:
        self._bar = bar
        self._maps = maps
        self._ready = 0
        self._work = bar.total, bar.desc, bar.unit
        bar.desc = "prepare maps"
        bar.unit = "%"
        bar.reset(total=100)
        bar.set_postfix_str(f"0 of {maps} ready")

    def preparing(self, share: float) -> None:
        """Show the share of the preparation that is done, in [0, 1]."""
        if self._ready < self._maps:
            self._bar.update(round(100 * share, 1) - self._bar.n)

    def unfinished(self, episodes: int) -> None:
        """Show the number of finished episodes that the bar does not count yet, because their batches are
        unfinished."""
        self._bar.set_postfix_str(f"{episodes} more in unfinished batches" if episodes else "")

    def maps_ready(self, ready: int) -> None:
        """Show the number of prepared maps; after the last one the bar shows the work."""
        self._ready = ready
        if ready < self._maps:
            self._bar.set_postfix_str(f"{ready} of {self._maps} ready")
            return
        total, self._bar.desc, self._bar.unit = self._work
        self._bar.reset(total=total)
        self._bar.set_postfix_str(f"{ready} maps ready")
