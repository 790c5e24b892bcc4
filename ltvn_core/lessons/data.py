"""What weights are fine-tuned on: a drive labelled by odometry, and simulated pairs that keep them from unlearning.

Owns where both come from. The labels are `ltvn_core.data.trajectory_pairs`; learning is `ltvn_core.model.finetuning`.
"""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from ltvn_core.data.trajectory_pairs import DriveRule, TrajectoryPairs
    from ltvn_core.model.assessment import Drive
    from ltvn_core.model.finetuning import FineTuningData
    from ltvn_core.types import Intrinsics, Observation

Tell: TypeAlias = Callable[[float, str], None]
"""Takes the share that is done, in [0, 1], and what is being done, for a person."""

MIXED = ("train-00", "train-07", "train-14", "train-21")
"""Scenes that are shown in between where no dataset is named,"""
CHECKED = ("tune-0", "tune-1")
"""and those by which old knowledge and the calibration are checked."""
_MOST_SCENES = 8
"""More scenes of a dataset would fill the memory and are not needed for a few minutes."""


def read_drive(path: Path, *, horizon: int, gated: bool) -> "TrajectoryPairs":
    """Read a recording and label its pairs by odometry. Raises RecordingError."""
    from ltvn_core.data.trajectory_pairs import PairRule
    from ltvn_core.recording.reader import Recording

    recording = Recording.open(path)
    observations = [recording.observation(frame) for frame in recording.frames]
    rule = PairRule(horizon=horizon, gated=gated)
    return label_drive(observations, path.name, camera=recording.meta.intrinsics, rule=rule)


def label_drive(
    observations: "Sequence[Observation]", name: str, *, camera: "Intrinsics", rule: "DriveRule"
) -> "TrajectoryPairs":
    """Label the pairs of images at hand by a rule. Raises RecordingError if they are no drive."""
    import numpy as np

    from ltvn_core.data.trajectory import trajectory
    from ltvn_core.data.trajectory_pairs import label_trajectory

    drive = trajectory(observations, name, camera=camera)
    return label_trajectory(drive, rule, np.random.default_rng(0))


def with_simulation(
    drive: "TrajectoryPairs", folder: Path | None, tell: Tell | None = None, *, judged: bool = True
) -> "FineTuningData":
    """Add simulated pairs to a drive: of a dataset, or of a few scenes rendered here. Raises DatasetError.

    `tell` hears of progress; what it raises ends the work, and what was rendered until then is kept. Drives through
    simulated rooms are for judging alone, and left out where nobody judges.
    """
    from ltvn_core.data.shards import read_shard
    from ltvn_core.model.finetuning import FineTuningData

    tell = tell or _untold
    learned, validation = _chosen(folder) if folder is not None else render_simulation(tell)
    drives = []
    for number, name in enumerate(CHECKED if judged else ()):
        tell(0.8 + 0.2 * number / len(CHECKED), "driving through simulated rooms")
        drives.append(_drive_through(name))
    return FineTuningData(
        drive, [read_shard(path) for path in learned], [read_shard(path) for path in validation], drives
    )


@cache
def _drive_through(name: str) -> "Drive":
    from ltvn_core.lessons.unseen import drives

    return drives([name], images=150)[0]


def render_simulation(tell: Tell | None = None) -> tuple[list[Path], list[Path]]:
    """Return shards of a few scenes in the user's cache to learn from and to check by, made there at the first call."""
    from platformdirs import user_cache_path

    from ltvn_core.data.generate import DatasetRecipe, generate
    from ltvn_core.lessons.worlds import open_world

    def made(count: int, of: int) -> None:
        (tell or _untold)(
            0.8 * count / of,
            "simulated rooms" if count == of else f"drawing simulated rooms, once only: {count} of {of}",
        )

    folder = user_cache_path("ltvn") / "finetuning"
    recipe = DatasetRecipe(clusters=100)
    paths = generate((*MIXED, *CHECKED), open_world, folder, recipe, on_made=made)
    return paths[: len(MIXED)], paths[len(MIXED) :]


def _untold(share: float, doing: str) -> None:
    """Nobody wants to know."""


def _chosen(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return some shards of a dataset, evenly over its scenes. Raises DatasetError if there are none of a kind."""
    from ltvn_core.data.shards import shard_path
    from ltvn_core.errors import DatasetError

    shards = sorted(folder.glob("*.pairs.safetensors"))
    validation = [path for path in (shard_path(folder, name) for name in CHECKED) if path in shards]
    learned = [path for path in shards if not path.name.startswith("tune-")]
    if not learned or not validation:
        raise DatasetError(
            f"{folder}: needs shards of scenes to learn from and of {' or '.join(CHECKED)}, found "
            f"{len(shards)} in all; run `ltvn dataset --folder {folder}`, or leave --data out to have some rendered."
        )
    return learned[:: max(-(-len(learned) // _MOST_SCENES), 1)], validation
