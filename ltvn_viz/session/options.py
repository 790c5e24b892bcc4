"""Options of the app: those of the command line, and those of who opens it by a program."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ltvn_core.data.importing.floor_plan_alignment import LaidFloorPlan
from ltvn_core.systems.registry import system_entry
from ltvn_viz.app_settings import AppSettings
from ltvn_viz.session.fine_tuner import FineTuner

DEMO_SCENE = "demo"


@dataclass(frozen=True, kw_only=True)
class AppOptions(AppSettings):
    """Settings of the app, and what it opens besides."""

    tuner: FineTuner = field(default_factory=FineTuner)
    """Fine-tunes the network from the page, by the labels of `system`."""
    replay: str | None = None
    """Name of a recording in the folder to open at once; then simulator and network may be missing."""
    replay_at_s: float = 0.0
    """Initial time of playback, in seconds after the recording's beginning."""
    replay_question: str = ""
    """Word of the debugger's initial question; empty for none."""
    floor_plan: LaidFloorPlan | None = None
    """Floor plan of the building to draw below the map."""
    questions: Sequence[Callable[[], Any]] = ()
    """Additional questions for the debugger, as classes whose constructors take no arguments."""

    @property
    def start_weights(self) -> Path | None:
        """Initial weights; None means the predictor's own. Raises OptionError for an unknown system."""
        return system_entry(self.system).weights_for(self.predictor, self.weights)
