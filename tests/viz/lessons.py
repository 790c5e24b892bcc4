"""What a lesson needs, as small as it can be: a drive through the box world, tiny weights, a plan of a few steps."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import torch

from ltvn_core.data.trajectory_pairs import TrajectoryPairs
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.lessons.data import Tell
from ltvn_core.model.finetuning import FineTuningData, FineTuningPlan
from ltvn_core.model.learner import LearningPlan
from ltvn_core.model.network import PairNetwork
from ltvn_core.model.weights import save_weights
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.types import Observation
from ltvn_core.verbs.tuning import Tuner
from tests.core.data.own_drive import along, look
from tests.core.model.examples import SMALL, tiny_drive, tiny_shard
from tests.viz.theatre import Theatre

PLAN = FineTuningPlan(
    LearningPlan(groups=4, confusions=1, hard=6, random=4, rate=1e-3),
    minutes=None,
    steps=3,
    minings=1,
    validation_pairs=60,
    validation_far=60,
)


@lru_cache
def drive() -> tuple[Observation, ...]:
    """Return images of a drive, with frame numbers that no robot of a test comes to."""
    poses = along((1.0, 1.0), (3.2, 1.0), (3.2, 3.3), (6.5, 3.3), (6.5, 1.0))
    return tuple(replace(seen, step=seen.step + 100_000) for seen in look(poses, exact=list(poses)))


def simulated(drive: TrajectoryPairs, tell: Tell) -> FineTuningData:
    """Add tiny simulated data at once."""
    tell(0.5, "looking at boxes")
    return FineTuningData(drive, [tiny_shard()], [tiny_shard("b")], [tiny_drive()])


TUNER = Tuner(PLAN, simulated)


def tiny_weights(folder: Path) -> Path:
    """Write weights that know nothing."""
    torch.manual_seed(0)
    save_weights(PairNetwork(SMALL), folder / "start.safetensors")
    return folder / "start.safetensors"


def show_drive(theatre: Theatre) -> None:
    """Let the map have the images of the drive at hand."""
    theatre.stage.mapping.load(TopologicalGraph(), drive())


def record_drive(path: Path, images: int | None = None) -> Path:
    """Write a recording of the drive, or of its first images."""
    with RecordingWriter(path, scene="box", config={}, fingerprint="") as writer:
        for seen in drive()[:images]:
            writer.frame(seen)
    return path
