"""What writing and reading a recording costs, with real pictures of the demo apartment."""

import tempfile
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np

from benchmarks.measurement import Measurement, measured, seconds
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.preprocessing import ORIGINAL_SIZE, rectify_observation
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation

STEPS = 5_000
OBSERVATIONS = 100
LARGE_CAMERA = CameraModel.from_fov(640, 480, radians(80), height_m=LOCOBOT.camera.height_m)


def write_and_read() -> list[Measurement]:
    """Write 5,000 steps of 96 x 72, without and with original pictures of 320 x 240, and read all of them back."""
    return [*_write_and_read(demo_observations(OBSERVATIONS), "96 x 72"), *_with_originals()]


def _write_and_read(observations: list[Observation], what: str) -> list[Measurement]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.rrd"
        steps = iter(range(STEPS))
        with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:

            def write() -> None:
                step = next(steps)
                writer.write_frame(replace(observations[step % OBSERVATIONS], step=step, stamp=0.1 * step))

            step_s = seconds(write, STEPS - 1)
        return [
            measured(f"log one {what} step", 1e3 * step_s, "ms", at_most=1),
            measured(f"size of one {what} step", path.stat().st_size / STEPS / 1e3, "kB", at_most=11),
            measured(f"read 5,000 steps of {what} back", seconds(lambda: _read(path), 1), "s", at_most=3),
        ]


def _with_originals() -> list[Measurement]:
    """As a robot with a camera of 640 x 480 records; compressing its pictures is measured apart."""
    taken = iter(demo_observations(OBSERVATIONS, LARGE_CAMERA))
    fitted = list[Observation]()

    def fit() -> None:
        seen = rectify_observation(next(taken), LARGE_CAMERA, LOCOBOT.camera, original_size=ORIGINAL_SIZE)
        fitted.append(seen)

    rectify_s = seconds(fit, OBSERVATIONS - 1)
    return [
        *_write_and_read(fitted, "96 x 72 with its 320 x 240 original"),
        measured("rectify one 640 x 480 image and compress its original", 1e3 * rectify_s, "ms", at_most=5),
    ]


def demo_observations(count: int, camera: CameraModel = LOCOBOT.camera) -> list[Observation]:
    """Return looks at random places of the demo apartment."""
    from ltvn_core.simulation.rendering.renderer_opening import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene

    scene = load_scene("demo")
    renderer = open_renderer(scene)
    poses = scene.clearance.sample_poses(np.random.default_rng(0), count)
    return [Observation(*renderer.render(pose, camera), pose, 0.1 * k, k, pose) for k, pose in enumerate(poses)]


def _read(path: Path) -> None:
    recording = Recording.open(path)
    for frame in recording.frames:
        recording.observation(frame)
