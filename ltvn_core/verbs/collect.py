"""`ltvn collect`: records a mapping drive."""

from dataclasses import dataclass

from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Summary, Verb, do_job


@dataclass(frozen=True, kw_only=True)
class CollectVerb(Verb):
    """Drive a scripted tour through a scene, as a person mapping it would, and record it."""

    job = "ltvn_core.verbs.jobs.collect:collect"

    output: NewRecording
    """The recording to write; must not exist yet."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """Number of rounds of the mapping drive."""
    seed: int = 0
    """Seed of the start, the order of rooms and the odometry noise."""
    distance_noise: float = 0.02
    """Standard deviation of the odometry error in distance, as a share of the distance."""
    angle_noise: float = 0.01
    """Standard deviation of the odometry error in angle, as a share of the angle."""
    body: BodyOption = "auto"
    robot: str | None = None
    """Record the images of your own robot while you drive it by its own controls: the name of an installed robot,
    path/to/file.py:factory, or PROFILE@ADDRESS (ROS 2)."""
    seconds: float = 0.0
    """With --robot: end after this time, in seconds; 0 records until Ctrl-C."""

    def run(self) -> Summary:
        """Tour the scene, or record your own robot; raises OptionError, RobotError, SceneError and RecordingError."""
        return do_job(self.job if self.robot is None else "ltvn_core.verbs.jobs.own_robot:collect_with", self)
