"""Options of the app from the command line."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ltvn_core.data.importing.floor_plan_alignment import LaidFloorPlan
from ltvn_core.predictors.choice import AUTO
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_viz.session.fine_tuner import FineTuner

DEMO_SCENE = "demo"


@dataclass(frozen=True)
class AppOptions:
    """Options of the app."""

    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    scene: str = ""
    """Scene to drive in; a map sets its own scene. By default the demo apartment, or the name of the user's robot."""
    robot: str | None = None
    """The user's robot instead of the simulated one: an installed name, or path/to/file.py:factory."""
    map: Path | None = None
    """Map to start with; None takes the ready-made one in the demo scene, else an empty one."""
    recordings: Path = Path("recordings")
    """Folder for recordings."""
    predictor: str = AUTO
    """Name of the predictor; `auto` takes the one that made the map, else the better one for the camera."""
    weights: Path | None = None
    """Weights instead of those that come with the system."""
    system: str = DEFAULT_SYSTEM
    """Name of the navigation system; a map sets its own."""
    preset: str = "robust"
    """Name of the method's settings."""
    maintenance: str | None = None
    """Name of the maintenance; None means the system's own."""
    world: str | None = None
    """Name or file of a script that changes the scene; None means no changes."""
    seed: int = 0
    """Seed for the robot's start and its odometry noise."""
    body: BodyName = "auto"
    """Body that moves the simulated robot."""
    tuner: FineTuner = field(default_factory=FineTuner)
    """Fine-tunes the network from the page, by the labels of `system`."""
    stream: int | None = None
    """Port on 127.0.0.1 at which Rerun viewers can watch the recording."""
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
