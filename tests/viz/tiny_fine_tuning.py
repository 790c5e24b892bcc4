"""What fine-tuning needs, as small as it can be: a drive through the box world, tiny weights, a plan of a few steps."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import torch

from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData, FineTuningPlan
from ltvn_core.network.optimization.trainer import Hyperparameters
from ltvn_core.network.training_data.trajectory_pairs import TrajectoryPairs
from ltvn_core.network.weights_file import save_weights
from ltvn_core.training.fine_tuning_data import ProgressReporter, RehearsalData, ignore_progress
from ltvn_core.types import Observation
from ltvn_viz.session.fine_tuner import FineTuner
from tests.core.network.tiny_data import SMALL, tiny_drive, tiny_shard
from tests.core.network.training_data.example_drive import observations_at, poses_along
from tests.viz.session_harness import SessionHarness

PLAN = FineTuningPlan(
    Hyperparameters(groups=4, confusions=1, hard=6, random=4, rate=1e-3),
    minutes=None,
    steps=3,
    minings=1,
    validation_pairs=60,
    validation_far=60,
)


IMAGES = 45


@lru_cache
def drive() -> tuple[Observation, ...]:
    """Return images of a drive, with frame numbers that no robot of a test comes to."""
    poses = poses_along((1.0, 1.0), (3.2, 1.0), (3.2, 3.3), (6.5, 3.3), (6.5, 1.0))
    return tuple(replace(seen, step=seen.step + 100_000) for seen in observations_at(poses, exact=list(poses)))


class TinyRehearsal(RehearsalData):
    """Tiny simulated data that are there at once."""

    @property
    def name(self) -> str:
        return "boxes"

    @property
    def scenes(self) -> Sequence[str]:
        return ("a",)

    def prepare(self, on_progress: ProgressReporter = ignore_progress) -> None:
        """Need nothing."""

    def load(
        self, drive: TrajectoryPairs, on_progress: ProgressReporter, *, with_validation_drives: bool
    ) -> FineTuningData:
        """Put the data beside a drive."""
        on_progress(0.5, "looking at boxes")
        return FineTuningData(drive, [tiny_shard()], [tiny_shard("b")], [tiny_drive()])


TUNER = FineTuner(plan=PLAN, rehearsal=TinyRehearsal())


def tiny_weights(folder: Path) -> Path:
    """Write weights that know nothing."""
    torch.manual_seed(0)
    save_weights(PairNetwork(SMALL), folder / "start.safetensors")
    return folder / "start.safetensors"


def show_drive(harness: SessionHarness) -> None:
    """Let the map have the first images of the drive at hand; of all of them a map takes long to build."""
    live_map = harness.state.live_map
    live_map.load(TopologicalMap.of(live_map.predictor, live_map.system, observations=drive()[:IMAGES]))


def record_drive(path: Path, images: int | None = None) -> Path:
    """Write a recording of the drive, or of its first images."""
    with RecordingWriter(path, scene="box", config={}, fingerprint="") as writer:
        for seen in drive()[:images]:
            writer.write_frame(seen)
    return path
