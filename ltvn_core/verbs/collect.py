"""`ltvn collect`: records a mapping drive."""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.verb import Summary, Verb, do_job


@dataclass(frozen=True, kw_only=True)
class CollectVerb(Verb):
    """Drive a scripted tour through a scene, as a person mapping it would, and record it."""

    job = "ltvn_core.verbs.jobs.collect:collect"

    output: Path
    """The recording to write; must not exist yet."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """Number of rounds of the mapping drive."""
    seed: int = 0
    """Draws the start, the order of rooms and the odometry noise."""
    distance_noise: float = 0.02
    """Standard deviation of odometry's error in distance, as a share of the distance."""
    angle_noise: float = 0.01
    """Standard deviation of odometry's error in angle, as a share of the angle."""
    body: BodyOption = "auto"
    robot: str | None = None
    """Record what a robot of your own sees while you drive it by its own controls: an installed robot's name,
    path/to/file.py:factory, or PROFILE@ADDRESS (ROS 2)."""
    seconds: float = 0.0
    """With --robot: end after this number of seconds; 0 is until Ctrl-C."""

    def run(self) -> Summary:
        """Tour the scene, or watch a robot of one's own; raises OptionError, RobotError, SceneError, RecordingError."""
        return do_job(self.job if self.robot is None else "ltvn_core.verbs.jobs.own_robot:collect_with", self)
