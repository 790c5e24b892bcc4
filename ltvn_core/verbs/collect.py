"""`ltvn collect`: records a scripted tour of a scene."""

import logging
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from ltvn_core.errors import OptionError, SceneError
from ltvn_core.findings import Finding, WithDoubts, findings_of
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Verb

_LOG = logging.getLogger(__name__)
MANY_WITHOUT_DEPTH = 0.3
"""Share of images without depth that leads to a warning; in a house that is open on one side it is about a tenth."""


@dataclass(frozen=True)
class CollectSummary(WithDoubts):
    """Summary of a mapping drive."""

    recording: Path
    scene: str
    frames: int
    without_depth: int
    """Number of images in which the camera found no depth; they are kept, but a map is built without them."""
    collisions: int
    driven_s: float
    """Duration of the drive, in seconds on the robot's clock."""
    findings: tuple[Finding, ...] = ()
    """Warnings about the drive; empty if there are none."""


_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CollectVerb(Verb):
    """Drive a scripted tour through a scene, as a person mapping it would, and record it."""

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

    def run(self) -> CollectSummary:
        """Tour the scene, or record your own robot; raises OptionError, RobotError, SceneError and RecordingError."""
        import numpy as np
        from tqdm import tqdm

        from ltvn_core.data.recording.recorded_run import record_images
        from ltvn_core.data.recording.writer import RecordingWriter
        from ltvn_core.simulation.body_selection import choose_body
        from ltvn_core.simulation.opening import open_simulation
        from ltvn_core.simulation.scripted_tour import drive_tour
        from ltvn_core.simulation.wheel_odometry import OdometryNoise

        if self.robot is not None:
            return collect_with(self)
        if self.loops < 1:
            raise OptionError(f"--loops must be 1 or more, got {self.loops}.")
        if not (0 <= self.distance_noise < 1 and 0 <= self.angle_noise < 1):
            raise OptionError(
                "--distance-noise and --angle-noise are shares from 0 to below 1; 0.05 is a bad odometer."
            )

        noise = OdometryNoise(self.distance_noise, self.angle_noise)
        simulation = open_simulation(self.scene, seed=self.seed, odometry_noise=noise, body=self.body)
        robot = simulation.robot
        settings = {
            "verb": "collect",
            "loops": self.loops,
            "seed": self.seed,
            "odometry_noise": asdict(noise),
            "body": choose_body(self.body),
        }
        with RecordingWriter(
            self.output,
            scene=simulation.scene.address,
            config=settings,
            fingerprint="",
            scene_glb=simulation.scene.glb(),
        ) as writer:
            rng = np.random.default_rng(self.seed)
            images = record_images(drive_tour(robot, simulation.scene, rng, loops=self.loops), writer)
            has_depth = [image.has_depth for image in tqdm(images, desc="collect", unit="frame")]
        return CollectSummary(
            findings=(*findings_of(simulation.scene.doubts), *depth_findings(self.output, has_depth)),
            recording=self.output,
            scene=simulation.scene.name,
            frames=len(has_depth),
            without_depth=has_depth.count(False),
            collisions=robot.collisions,
            driven_s=robot.stamp,
        )


def depth_findings(recording: Path, has_depth: list[bool]) -> tuple[Finding, ...]:
    """Return and log a warning if many images have no depth. Raises SceneError if no image has depth."""
    share = has_depth.count(False) / len(has_depth)
    if share == 1.0:
        raise SceneError(
            f"None of the {len(has_depth)} images in {recording} shows anything within reach of the depth camera; is "
            "the scene a mesh of rooms, the right way up?"
        )
    if share < MANY_WITHOUT_DEPTH:
        return ()
    text = f"{share:.0%} of the images have no depth; is the scene open on all sides, or the wrong way up?"
    _LOG.warning(text)
    return (Finding(text),)


def collect_with(options: CollectVerb) -> CollectSummary:
    """Record the images of a robot while somebody else drives it, until Ctrl-C or for `options.seconds`.

    A recorded drive that is played as a robot also ends the recording.
    """
    import numpy as np

    from ltvn_core.data.recording.recorded_run import RunDescription, record_images
    from ltvn_core.predictors.choice import ImageSource
    from ltvn_core.predictors.opening import open_predictor
    from ltvn_core.robots.robot import open_loop_word
    from ltvn_core.robots.robot_view import fit_camera, watch_drive
    from ltvn_core.verbs.robot_queries import opened_robot

    name = str(options.robot)
    with opened_robot(name, drives=False) as own:
        choice = ImageSource(camera=own.spec.camera).choose()
        robot = fit_camera(own, open_predictor(choice.name, camera=own.spec.camera).camera)
        scene = own.spec.name if options.scene == "demo" else options.scene
        run = RunDescription(
            scene=scene,
            config={"verb": "collect", "robot": name, **own.spec.needed_space.to_config()},
            fingerprint="",
            camera=robot.spec.camera,
        )
        begun_s = time.monotonic()
        has_depth: list[bool] = []
        _LOG.info(open_loop_word(own) or "Recording; drive the robot with its own controls. Ctrl-C ends the recording.")
        with run.open_writer(options.output) as writer:
            most_s = options.seconds or np.inf
            images = watch_drive(robot, lambda: getattr(own, "is_over", False) or time.monotonic() - begun_s >= most_s)
            with suppress(KeyboardInterrupt):
                for image in record_images(images, writer):
                    has_depth.append(image.has_depth)
        return CollectSummary(
            findings=depth_findings(options.output, has_depth),
            recording=options.output,
            scene=scene,
            frames=len(has_depth),
            without_depth=has_depth.count(False),
            collisions=0,
            driven_s=time.monotonic() - begun_s,
        )
