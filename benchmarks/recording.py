"""What writing and reading a recording costs, with real pictures of the demo apartment."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.measurement import Measurement, measured, seconds
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation

STEPS = 5_000
OBSERVATIONS = 100


def write_and_read() -> list[Measurement]:
    """Write 5,000 steps of 96 x 72 and read all of them back."""
    observations = demo_observations(OBSERVATIONS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.rrd"
        steps = iter(range(STEPS))
        with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:

            def write() -> None:
                step = next(steps)
                writer.write_frame(replace(observations[step % OBSERVATIONS], step=step, stamp=0.1 * step))

            step_s = seconds(write, STEPS - 1)
        return [
            measured("log one 96 x 72 step", 1e3 * step_s, "ms", at_most=1),
            measured("size of one 96 x 72 step", path.stat().st_size / STEPS / 1e3, "kB", at_most=11),
            measured("read 5,000 steps back", seconds(lambda: _read(path), 1), "s", at_most=3),
        ]


def demo_observations(count: int) -> list[Observation]:
    """Return looks at random places of the demo apartment."""
    from ltvn_core.simulation.rendering.renderer_selection import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene

    scene = load_scene("demo")
    renderer = open_renderer(scene)
    poses = scene.clearance.sample_poses(np.random.default_rng(0), count)
    return [Observation(*renderer.render(pose, LOCOBOT.camera), pose, 0.1 * k, k, pose) for k, pose in enumerate(poses)]


def _read(path: Path) -> None:
    recording = Recording.open(path)
    for frame in recording.frames:
        recording.observation(frame)
