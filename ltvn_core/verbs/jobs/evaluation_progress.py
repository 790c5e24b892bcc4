"""Progress of long tests: a bar while they run, and a summary if other parts are unfinished.

The bar is that of `ltvn evaluate` and `ltvn lifelong`: first over the preparation of maps, then over the work.
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
    """Episodes, queries or scenes that this part has."""
    tests: int
    """Tests of all parts: one for each scene, seed and maintenance."""
    finished: int
    """Tests of all parts that are complete."""
    folder: Path
    """Where all parts belong."""
    wall_s: float


def progress_on_bar(bar: "tqdm[NoReturn]", maps: int) -> EvaluationProgress:
    """Return a progress callback: a bar for the work, which first shows how many maps are prepared."""
    shown = _PreparationOnBar(bar, maps)
    return EvaluationProgress(
        maps_ready=shown.maps_ready, work_done=bar.update, preparing=shown.preparing, unfinished=shown.unfinished
    )


class _PreparationOnBar:
    """Borrows a bar until all maps are ready, then gives it back as it was."""

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
        """Show the share of all preparation that is done."""
        if self._ready < self._maps:
            self._bar.update(round(100 * share, 1) - self._bar.n)

    def unfinished(self, episodes: int) -> None:
        """Say how many episodes are done that the bar does not count yet, because their batches are not over."""
        self._bar.set_postfix_str(f"{episodes} more in unfinished batches" if episodes else "")

    def maps_ready(self, ready: int) -> None:
        """Count the maps; with the last one the bar begins to show the work."""
        self._ready = ready
        if ready < self._maps:
            self._bar.set_postfix_str(f"{ready} of {self._maps} ready")
            return
        total, self._bar.desc, self._bar.unit = self._work
        self._bar.reset(total=total)
        self._bar.set_postfix_str(f"{ready} maps ready")
