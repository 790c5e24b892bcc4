"""`ltvn collect`: records a scripted tour of a scene."""

import logging
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ltvn_core.data.recording.recorded_run import record_images
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import OptionError, SceneError
from ltvn_core.findings import Finding, WithDoubts, findings_of
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scripted_tour import drive_tour
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.verbs.collect import CollectVerb

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


def collect(options: CollectVerb) -> CollectSummary:
    """Tour the scene; raises OptionError, SceneError and RecordingError."""
    if options.loops < 1:
        raise OptionError(f"--loops must be 1 or more, got {options.loops}.")
    if not (0 <= options.distance_noise < 1 and 0 <= options.angle_noise < 1):
        raise OptionError("--distance-noise and --angle-noise are shares from 0 to below 1; 0.05 is a bad odometer.")

    noise = OdometryNoise(options.distance_noise, options.angle_noise)
    simulation = open_simulation(options.scene, seed=options.seed, odometry_noise=noise, body=options.body)
    robot = simulation.robot
    settings = {
        "verb": "collect",
        "loops": options.loops,
        "seed": options.seed,
        "odometry_noise": asdict(noise),
        "body": choose_body(options.body),
    }
    with RecordingWriter(
        options.output,
        scene=simulation.scene.address,
        config=settings,
        fingerprint="",
        scene_glb=simulation.scene.glb(),
    ) as writer:
        rng = np.random.default_rng(options.seed)
        images = record_images(drive_tour(robot, simulation.scene, rng, loops=options.loops), writer)
        has_depth = [image.has_depth for image in tqdm(images, desc="collect", unit="frame")]
    return CollectSummary(
        findings=(*findings_of(simulation.scene.doubts), *depth_findings(options.output, has_depth)),
        recording=options.output,
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
