"""Data for fine-tuning: a self-labelled drive, and rehearsal data that prevent forgetting.

Owns the sources of both, and the two kinds of labels for the network of a navigation system: from odometry, or from
time alone. Label rules are in `network.training_data`; `training.fine_tuning` runs the learning.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ltvn_core.cache_folder import cache_folder
from ltvn_core.data.recording.drive_part import WHOLE_DRIVE, DrivePart
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation

if TYPE_CHECKING:
    from ltvn_core.cameras.camera_model import CameraModel
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData, FineTuningPlan
    from ltvn_core.network.pair_evaluation import LabelledDrive
    from ltvn_core.network.training_data.temporal_rules import TemporalLabelRule
    from ltvn_core.network.training_data.trajectory_pairs import LabelRule, TrajectoryPairs
    from ltvn_core.systems.entry import TemporalLearning

ProgressReporter: TypeAlias = Callable[[float, str], None]
"""Called with the share done in [0, 1], and the current activity as text."""

REHEARSAL_SCENES = ("train-00", "train-07", "train-14", "train-21")
"""Scenes for rehearsal if no data set is given."""
CALIBRATION_SCENES = ("tune-0", "tune-1")
"""Validation scenes, which measure forgetting and fit the calibration."""
_MOST_SCENES = 8
"""Largest number of scenes from a data set; more would fill the memory, and a few minutes of training do not need
them."""


def ignore_progress(share: float, doing: str) -> None:
    """Discard the progress."""


def read_labelled_drive(path: Path, rule: "LabelRule", part: DrivePart = WHOLE_DRIVE) -> "TrajectoryPairs":
    """Read a part of a recording for the network, and label its pairs of images. Raises RecordingError."""
    from ltvn_core.cameras.rectification import rectified_camera
    from ltvn_core.data.recording.reader import Recording
    from ltvn_core.network.architecture import NETWORK_CAMERA
    from ltvn_core.preprocessing import recorded_observation

    recording = Recording.open(path)
    camera = recording.meta.camera
    observations = [
        recorded_observation(recording.observation(frame), camera, NETWORK_CAMERA)
        for frame in part.take(recording.frames)
    ]
    return label_drive(observations, path.name, camera=rectified_camera(camera, NETWORK_CAMERA), rule=rule)


def label_drive(
    observations: "Sequence[Observation]", name: str, *, camera: "CameraModel", rule: "LabelRule"
) -> "TrajectoryPairs":
    """Label the pairs of images in memory by a rule. Raises RecordingError if the images are not a usable drive."""
    import numpy as np

    from ltvn_core.network.training_data.trajectory import select_keyframes
    from ltvn_core.network.training_data.trajectory_pairs import label_trajectory

    drive = select_keyframes(observations, name, camera=camera)
    return label_trajectory(drive, rule, np.random.default_rng(0))


@dataclass(frozen=True, slots=True)
class RehearsalData:
    """Labelled images of other places, mixed with a drive so that the network does not forget.

    They are pairs of simulated images labelled by exact poses; with a rule, random walks labelled by time alone.
    """

    folder: Path | None = None
    """Folder written by `ltvn dataset`, or with a rule the parent of the folder `walks`; None makes a few scenes in the
    user's cache at the first use."""
    rule: "TemporalLabelRule | None" = None
    """Rule that labels the drive, too; None labels by poses."""

    @property
    def name(self) -> str:
        """Name that identifies these data."""
        kind = "random walks" if self.rule else "simulated pairs"
        return kind if self.folder is None else f"{kind} of {self.folder}"

    @property
    def scenes(self) -> Sequence[str]:
        """Training scenes. Raises DatasetError if the folder has none."""
        from ltvn_core.network.training_data.shards import shard_scene

        if self.folder is None or self.rule:
            return REHEARSAL_SCENES
        learned, _ = _select_shards(self.folder)
        return [shard_scene(path) for path in learned]

    def prepare(self, on_progress: ProgressReporter = ignore_progress) -> None:
        """Create missing files, once for all processes that will load them. Raises DatasetError and SceneError."""
        from ltvn_core.training.simulated_scenes import make_walks

        if self.rule:
            make_walks((*REHEARSAL_SCENES, *CALIBRATION_SCENES), self._walks, on_progress=_count_scenes(on_progress))
        elif self.folder is None:
            _render_scenes(on_progress)

    def load(
        self, drive: "TrajectoryPairs", on_progress: ProgressReporter, *, with_validation_drives: bool
    ) -> "FineTuningData":
        """Return these data together with a drive. Raises DatasetError and SceneError.

        An exception in `on_progress` stops the work, but the files made until then are kept. `with_validation_drives`
        includes drives through simulated rooms, which are only for evaluation and which random walks lack.
        """
        from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData
        from ltvn_core.network.training_data.shards import read_shard
        from ltvn_core.training.simulated_scenes import labelled_walks

        if self.rule:
            self.prepare(on_progress)
            scenes, validation = (
                labelled_walks(self.rule, names, self._walks) for names in (REHEARSAL_SCENES, CALIBRATION_SCENES)
            )
            return FineTuningData(drive=drive, scenes=scenes, validation=validation)
        learned, validation = _render_scenes(on_progress) if self.folder is None else _select_shards(self.folder)
        drives = []
        for number, scene in enumerate(CALIBRATION_SCENES if with_validation_drives else ()):
            on_progress(0.8 + 0.2 * number / len(CALIBRATION_SCENES), "driving through simulated rooms")
            drives.append(_simulated_drive(scene))
        return FineTuningData(
            drive=drive,
            scenes=[read_shard(path) for path in learned],
            validation=[read_shard(path) for path in validation],
            drives=drives,
        )

    @property
    def _walks(self) -> Path:
        return (self.folder or cache_folder()) / "walks"


@cache
def _simulated_drive(name: str) -> "LabelledDrive":
    from ltvn_core.training.held_out_scenes import drives

    return drives([name], images=150)[0]


def _render_scenes(on_progress: ProgressReporter) -> tuple[list[Path], list[Path]]:
    """Return training and validation shards of a few scenes in the user's cache; they are rendered at the first
    call."""
    from ltvn_core.network.training_data.shards import DatasetRecipe, generate_shards
    from ltvn_core.training.simulated_scenes import open_dataset_scene

    paths = generate_shards(
        (*REHEARSAL_SCENES, *CALIBRATION_SCENES),
        open_dataset_scene,
        cache_folder() / "finetuning",
        DatasetRecipe(clusters=100),
        on_progress=_count_scenes(on_progress),
    )
    return paths[: len(REHEARSAL_SCENES)], paths[len(REHEARSAL_SCENES) :]


def _count_scenes(on_progress: ProgressReporter) -> Callable[[int, int], None]:
    """Return a callback that reports the number of finished scenes as the first four fifths of the progress."""

    def report(count: int, total: int) -> None:
        doing = f"rendering simulated rooms (only once): {count} of {total}"
        on_progress(0.8 * count / total, "simulated rooms" if count == total else doing)

    return report


def _select_shards(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return some training and validation shards of a data set, evenly spread. Raises DatasetError if either kind is
    missing."""
    from ltvn_core.errors import DatasetError
    from ltvn_core.network.training_data.shards import dataset_shards, shard_scene

    shards = dataset_shards(folder)
    validation = [path for path in shards if shard_scene(path) in CALIBRATION_SCENES]
    learned = [path for path in shards if not path.name.startswith("tune-")]
    if not learned or not validation:
        raise DatasetError(
            f"{folder}: needs shards of training scenes and of {' or '.join(CALIBRATION_SCENES)}, found "
            f"{len(shards)} in all; run `ltvn dataset --folder {folder}`, or omit --data to render some."
        )
    return learned[:: max(-(-len(learned) // _MOST_SCENES), 1)], validation


@dataclass(frozen=True)
class DriveSource:
    """A drive to learn from."""

    name: str
    """Name of the drive in the card."""
    source: Path | Sequence[Observation]
    """A recording, or images in the order in which they were taken."""

    def label(self, rule: "LabelRule") -> "TrajectoryPairs":
        """Label the drive's pairs of images. Raises RecordingError if it is not a usable drive."""
        if isinstance(self.source, Path):
            return read_labelled_drive(self.source, rule)
        return label_drive(self.source, self.name, camera=LOCOBOT.camera, rule=rule)


@dataclass(frozen=True, slots=True)
class SystemTraining:
    """Kind of learning for the network of a navigation system, from its entry: labels, rehearsal data and plan.

    Odometry and depth label the drive, and exact poses the simulated rehearsal pairs; or, with `temporal`, the number
    of steps labels the pairs of the drive and of random walks, without poses.
    """

    temporal: "TemporalLearning | None"
    """Settings for learning from time alone."""

    def label_rule(self) -> "LabelRule":
        """Return the rule that labels the pairs of a drive."""
        from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule

        return self.temporal.rule if self.temporal else OdometryLabelRule()

    def rehearsal(self, folder: Path | None = None) -> RehearsalData:
        """Return the rehearsal data; `folder` names existing data, otherwise they are made once and kept."""
        return RehearsalData(folder, self.temporal and self.temporal.rule)

    def adapt_plan(self, plan: "FineTuningPlan") -> "FineTuningPlan":
        """Return a fine-tuning plan that uses only information that this system has: mining needs poses."""
        from ltvn_core.network.baseline_training import baseline_fine_tuning_plan

        return baseline_fine_tuning_plan(plan, even_distances=self.temporal.even_distances) if self.temporal else plan
