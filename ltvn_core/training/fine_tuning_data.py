"""What weights are fine-tuned on: a drive labelled by odometry, and simulated pairs that keep them from unlearning.

Owns where both come from. The labels are `ltvn_core.training_data.trajectory_pairs`; learning is
`ltvn_core.network.optimization.fine_tuning_loop`.
"""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from ltvn_core.cameras.camera_model import CameraModel
    from ltvn_core.network.metrics.pair_evaluation import LabelledDrive
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData
    from ltvn_core.training_data.trajectory_pairs import LabelRule, TrajectoryPairs
    from ltvn_core.types import Observation

ProgressReporter: TypeAlias = Callable[[float, str], None]
"""Takes the share that is done, in [0, 1], and what is being done, for a person."""

REHEARSAL_SCENES = ("train-00", "train-07", "train-14", "train-21")
"""Scenes that are shown in between where no dataset is named,"""
CALIBRATION_SCENES = ("tune-0", "tune-1")
"""and those by which old knowledge and the calibration are checked."""
_MOST_SCENES = 8
"""More scenes of a dataset would fill the memory and are not needed for a few minutes."""


def read_labelled_drive(path: Path, *, horizon: int, gated: bool) -> "TrajectoryPairs":
    """Read a recording and label its pairs by odometry. Raises RecordingError."""
    from ltvn_core.recording.reader import Recording
    from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule

    recording = Recording.open(path)
    observations = [recording.observation(frame) for frame in recording.frames]
    rule = OdometryLabelRule(horizon=horizon, gated=gated)
    return label_drive(observations, path.name, camera=recording.meta.camera, rule=rule)


def label_drive(
    observations: "Sequence[Observation]", name: str, *, camera: "CameraModel", rule: "LabelRule"
) -> "TrajectoryPairs":
    """Label the pairs of images at hand by a rule. Raises RecordingError if they are no drive."""
    import numpy as np

    from ltvn_core.training_data.trajectory import select_keyframes
    from ltvn_core.training_data.trajectory_pairs import label_trajectory

    drive = select_keyframes(observations, name, camera=camera)
    return label_trajectory(drive, rule, np.random.default_rng(0))


def add_simulated_pairs(
    drive: "TrajectoryPairs",
    folder: Path | None,
    on_progress: ProgressReporter | None = None,
    *,
    with_validation_drives: bool = True,
) -> "FineTuningData":
    """Add simulated pairs to a drive: of a dataset, or of a few scenes rendered here. Raises DatasetError.

    `on_progress` hears of progress; what it raises ends the work, and what was rendered until then is kept. Drives
    through simulated rooms are for judging alone, and left out where nobody judges.
    """
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData
    from ltvn_core.training_data.shards import read_shard

    on_progress = on_progress or _ignore_progress
    learned, validation = _select_shards(folder) if folder is not None else render_simulation(on_progress)
    drives = []
    for number, name in enumerate(CALIBRATION_SCENES if with_validation_drives else ()):
        on_progress(0.8 + 0.2 * number / len(CALIBRATION_SCENES), "driving through simulated rooms")
        drives.append(_simulated_drive(name))
    return FineTuningData(
        drive, [read_shard(path) for path in learned], [read_shard(path) for path in validation], drives
    )


@cache
def _simulated_drive(name: str) -> "LabelledDrive":
    from ltvn_core.training.held_out_scenes import drives

    return drives([name], images=150)[0]


def render_simulation(on_progress: ProgressReporter | None = None) -> tuple[list[Path], list[Path]]:
    """Return shards of a few scenes in the user's cache to learn from and to check by, made there at the first call."""
    from platformdirs import user_cache_path

    from ltvn_core.training.simulated_scenes import open_dataset_scene
    from ltvn_core.training_data.shard_generation import DatasetRecipe, generate_shards

    def made(count: int, of: int) -> None:
        (on_progress or _ignore_progress)(
            0.8 * count / of,
            "simulated rooms" if count == of else f"drawing simulated rooms, once only: {count} of {of}",
        )

    folder = user_cache_path("ltvn") / "finetuning"
    recipe = DatasetRecipe(clusters=100)
    paths = generate_shards(
        (*REHEARSAL_SCENES, *CALIBRATION_SCENES), open_dataset_scene, folder, recipe, on_progress=made
    )
    return paths[: len(REHEARSAL_SCENES)], paths[len(REHEARSAL_SCENES) :]


def _ignore_progress(share: float, doing: str) -> None:
    """Nobody wants to know."""


def _select_shards(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return some shards of a dataset, evenly over its scenes. Raises DatasetError if there are none of a kind."""
    from ltvn_core.errors import DatasetError
    from ltvn_core.training_data.shards import shard_path

    shards = sorted(folder.glob("*.pairs.safetensors"))
    validation = [path for path in (shard_path(folder, name) for name in CALIBRATION_SCENES) if path in shards]
    learned = [path for path in shards if not path.name.startswith("tune-")]
    if not learned or not validation:
        raise DatasetError(
            f"{folder}: needs shards of scenes to learn from and of {' or '.join(CALIBRATION_SCENES)}, found "
            f"{len(shards)} in all; run `ltvn dataset --folder {folder}`, or leave --data out to have some rendered."
        )
    return learned[:: max(-(-len(learned) // _MOST_SCENES), 1)], validation
