"""What a person may choose for the app: the options of `ltvn app`. Imports no large library."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, DeviceOption, PredictorName, SystemName


@dataclass(frozen=True, kw_only=True)
class AppSettings:
    """Settings of the app."""

    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    scene: str = ""
    """Scene by name (for an unknown name, the error lists all names), or the path of a mesh or a Gibson folder; by
    default the demo apartment. With --robot, the name of the place in recordings; by default the robot's name."""
    robot: str | None = None
    """Drive a robot of your own instead of the simulated one: an installed robot's name, path/to/file.py:factory, or
    PROFILE@ADDRESS (ROS 2), as in turtlebot4@tcp/192.168.0.7:7447. A recorded drive, such as drive.mcap, is played."""
    map: Path | None = None
    """Map to start with; by default the ready-made one in the demo apartment, else an empty one."""
    recordings: Path = Path("recordings")
    """Folder in which recordings are saved and found."""
    system: SystemName = DEFAULT_SYSTEM
    """Navigation system, ours or another one: it builds maps and drives by them. An opened map sets its own."""
    predictor: PredictorName = AUTO
    """Predictor that compares images, by name; auto uses the one that built the map, else the network for the simulated
    robot and geometric for your own robot with another camera.
    """
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    device: DeviceOption = "auto"
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    maintenance: MaintenanceName | None = None
    """How driving updates the map; by default as in the navigation system. static: not at all; paper, robust: beliefs
    and pruning as in that preset; brm: BRM's posterior, without pruning; persistent: also the times at which edges are
    open."""
    world: str | None = None
    """Change the scene over time, from nine o'clock on: static, doors, daily, telegraph, moving, light, people,
    all, several of them (doors+moving), or a JSON file with a script."""
    seed: int = 0
    """Seed for the robot's start, the odometry noise, and the changes of the world."""
    body: BodyOption = "auto"
    stream: int | None = None
    """Port on 127.0.0.1 at which a Rerun viewer (`ltvn view`) can watch the recording while it is written."""
