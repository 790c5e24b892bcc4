"""`ltvn collect`: a scripted tour of a scene becomes a recording."""

import logging
from dataclasses import asdict, dataclass
from pathlib import Path

from ltvn_core.errors import OptionError, SceneError
from ltvn_core.verbs.verb import Summary, Verb

log = logging.getLogger(__name__)

MANY_WITHOUT_DEPTH = 0.3
"""Share of images without depth that is doubtful; in a house that is open to one side it is about a tenth."""


@dataclass(frozen=True)
class CollectSummary:
    """What a tour brought home."""

    recording: Path
    scene: str
    frames: int
    without_depth: int
    """Frames in which the camera found no depth at all; they are kept, and a map is built without them."""
    collisions: int
    driven_s: float
    """Robot time."""
    doubts: tuple[str, ...] = ()
    """What is doubtful of the drive, in words; nothing where all is well."""


@dataclass(frozen=True, kw_only=True)
class CollectVerb(Verb):
    """Drive a scripted tour through a scene, as a person mapping it would, and record it."""

    output: Path
    """The recording to write; must not exist yet."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """How often the tour goes round."""
    seed: int = 0
    """Draws the start, the order of rooms and the odometry noise."""
    distance_noise: float = 0.02
    """Standard deviation of odometry's error in distance, as a share of it,"""
    angle_noise: float = 0.01
    """and in angle."""

    def run(self) -> Summary:
        """Tour the scene; raises OptionError, SceneError and RecordingError."""
        if self.loops < 1:
            raise OptionError(f"--loops must be 1 or more, got {self.loops}.")
        if not (0 <= self.distance_noise < 1 and 0 <= self.angle_noise < 1):
            raise OptionError(
                "--distance-noise and --angle-noise are shares from 0 to below 1; 0.05 is a bad odometer."
            )
        import numpy as np
        from tqdm import tqdm

        from ltvn_core.composition import open_simulation
        from ltvn_core.recording.recorded_robot import record_images
        from ltvn_core.recording.writer import RecordingWriter
        from ltvn_core.simulation.scripted_tour import drive_tour
        from ltvn_core.simulation.wheel_odometry import OdometryNoise

        noise = OdometryNoise(self.distance_noise, self.angle_noise)
        simulation = open_simulation(self.scene, seed=self.seed, odometry_noise=noise)
        robot = simulation.robot
        settings = {"verb": "collect", "loops": self.loops, "seed": self.seed, "odometry_noise": asdict(noise)}
        with RecordingWriter(self.output, scene=simulation.scene.address, config=settings, fingerprint="") as writer:
            rng = np.random.default_rng(self.seed)
            images = record_images(drive_tour(robot, simulation.scene, rng, loops=self.loops), writer)
            has_depth = [image.has_depth for image in tqdm(images, desc="collect", unit="frame")]
        return CollectSummary(
            doubts=_doubts(self.output, has_depth),
            recording=self.output,
            scene=simulation.scene.name,
            frames=len(has_depth),
            without_depth=has_depth.count(False),
            collisions=robot.collisions,
            driven_s=robot.stamp,
        )


def _doubts(recording: Path, has_depth: list[bool]) -> tuple[str, ...]:
    """Return, and log, that many images show nothing. Raises SceneError where none does."""
    share = has_depth.count(False) / len(has_depth)
    if share == 1.0:
        raise SceneError(
            f"None of the {len(has_depth)} images in {recording} shows anything within reach of the depth camera; is "
            "the scene a mesh of rooms, the right way up?"
        )
    if share < MANY_WITHOUT_DEPTH:
        return ()
    doubt = f"{share:.0%} of the images have no depth; is the scene open on all sides, or the wrong way up?"
    log.warning(doubt)
    return (doubt,)
