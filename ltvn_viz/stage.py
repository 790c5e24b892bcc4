"""Everything the session's thread owns, in one place: the live run, the map's keeper, and the mode of the moment.

Owns no rule of its own beyond how an activity is left; commands are carried out by `orders`, shown by `portrait`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeAlias

from ltvn_core.config import Method
from ltvn_core.nav.events import Severity
from ltvn_core.types import Pose, Predictor
from ltvn_viz.building import Building
from ltvn_viz.feed import Picture
from ltvn_viz.goals import Goals
from ltvn_viz.learning import Learning
from ltvn_viz.library import Library
from ltvn_viz.live import Live
from ltvn_viz.mapping import Mapping
from ltvn_viz.navigation import Navigation
from ltvn_viz.replay import Replay
from ltvn_viz.rerun_views import no_rerun
from ltvn_viz.snapshot import Message, Work
from ltvn_viz.teleop import Teleop
from ltvn_viz.viewpoint import Viewpoint
from ltvn_viz.why.cases import Cases
from ltvn_viz.why.inspector import Inspector
from ltvn_viz.why.later import Later
from ltvn_viz.why.tools import tools
from ltvn_viz.worker import Worker

Activity: TypeAlias = Teleop | Navigation | Building | Replay


class Feed(Protocol):
    """Pictures of the live camera for the person."""

    def look(self, pose: Pose) -> Picture:
        """Ask for a picture from `pose` (3,) and return the newest."""
        ...


@dataclass
class Stage:
    """What plays now and with whom."""

    scene: str
    live: Live
    mapping: Mapping
    worker: Worker
    library: Library
    open_replay: Callable[[str], Replay]
    """Reads a recording by its name in the library; runs in the worker's thread."""
    feed: Feed
    goals: Goals
    teleop: Teleop
    learning: Learning
    open_mind: Callable[[Path], tuple[Predictor, Method]]
    """Opens weights and the method that goes with them; runs in the worker's thread."""
    kept: str | None = None
    """The recording that was kept last."""
    message: Message | None = None
    work: Work | None = None
    """A job that the page should wait for, beside what an activity says itself."""
    queries: int = 0
    rerun: Callable[[Path], str] = no_rerun
    """Serves a recording in Rerun's web viewer and returns its address; runs in the worker's thread."""
    viewpoint: Callable[[], Viewpoint | None] = lambda: None
    """From where the person looks at the scene; None where there is no page."""
    look_back: float | None = None
    """A stamp of the live run that the page shows instead of now."""

    def __post_init__(self) -> None:
        """Begin with a person driving."""
        self.activity: Activity = self.teleop
        self.inspector = Inspector(tools(self.live.watch))
        self.cases = Cases(Later(self.worker, self.inspector.again))

    def say(self, text: str, severity: Severity = Severity.INFO) -> None:
        """Show a message in the page."""
        if self.message is None or (text, severity) != (self.message.text, self.message.severity):
            # An error that comes back with every tick is one message.
            self.message = Message(text, severity, self.message.number + 1 if self.message is not None else 1)

    def give_up(self, notice: str) -> None:
        """Leave a task before its end, and say so."""
        if isinstance(self.activity, Navigation | Building):
            self.activity.give_up()
            self.say(notice)

    def fail(self, text: str) -> None:
        """After an error: the robot stands, a task is dropped, the page says why."""
        self.live.robot.stop()
        self.work = None
        if isinstance(self.activity, Navigation | Building):
            self.activity = self.teleop
        self.say(text, Severity.ERROR)
