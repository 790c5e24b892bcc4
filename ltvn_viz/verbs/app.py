"""`ltvn app | replay`: the page in the browser."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from tyro.conf import Positional

from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName, SystemName
from ltvn_core.verbs.verb import Verb
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions


@dataclass(frozen=True, kw_only=True)
class AppVerb(FloorPlanOptions, Verb):
    """Open the page: drive, map, click a goal, watch. Without options: the demo apartment and its ready-made map."""

    job = "ltvn_viz.verbs.jobs.app:open_page"
    renamed: ClassVar[Mapping[str, str]] = {"--method": "a navigation system is named by --system NAME in all verbs"}

    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    scene: str = ""
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder; by default the
    demo apartment. With --robot: what recordings call the place, by default the robot's name."""
    robot: str | None = None
    """Drive a robot of your own instead of the simulated one: an installed robot's name, path/to/file.py:factory, or
    PROFILE@ADDRESS (ROS 2), as in turtlebot4@tcp/192.168.0.7:7447. A recorded drive, such as drive.mcap, is played."""
    map: Path | None = None
    """Map to begin with; by default the ready-made one in the demo apartment, else an empty one."""
    recordings: Path = Path("recordings")
    """Folder in which recordings are written and found."""
    system: SystemName = DEFAULT_SYSTEM
    """The navigation system, ours or a rival: it builds maps and drives by them. An opened map brings its own."""
    predictor: PredictorName = AUTO
    """Predictor that compares images, by name; auto uses the one that built the map, else the network for the simulated
    robot and geometric for your own robot with another camera.
    """
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    maintenance: MaintenanceName | None = None
    """How driving updates the map; by default as its system does. static: nothing; paper, robust: beliefs and
    pruning as in that preset; brm: BRM's posterior, which prunes nothing; persistent: also what is open at which
    time."""
    world: str | None = None
    """Change the scene over time, from nine o'clock on: static, doors, daily, telegraph, moving, light, people,
    all, several of them (doors+moving), or a JSON file with a script."""
    seed: int = 0
    """Draws the robot's start, the odometry noise and what changes in the world."""
    body: BodyOption = "auto"
    stream: int | None = None
    """Port on 127.0.0.1 at which a Rerun viewer can watch while the recording is written: `ltvn view` the address."""


@dataclass(frozen=True, kw_only=True)
class ReplayVerb(FloorPlanOptions, Verb):
    """Open the page on a recording, with a slider over its time."""

    job = "ltvn_viz.verbs.jobs.app:open_replay"

    recording: Positional[Path]
    """The .rrd file."""
    at: float = 0.0
    """Seconds after its beginning at which to show it first."""
    ask: str = ""
    """A question for the debugger to open with, by its word: blame (why is it so?), failures (what failed?), where,
    edge, what-if, time, presence, truth, or any other that a link of the page names."""
    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
