"""Weights that know one drive, for each system of the comparison, without a person who waits for them.

Owns which labels, simulated pairs and plan each system takes. Learning is
`ltvn_core.network.optimization.fine_tuning_loop`; for one's own recordings there is `ltvn finetune`.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import WeightsError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training.fine_tuning_data import (
    CALIBRATION_SCENES,
    REHEARSAL_SCENES,
    add_simulated_pairs,
    label_drive,
    render_simulation,
)
from ltvn_core.training.fine_tuning_provenance import FineTuningProvenance
from ltvn_core.training.labelled_walks import labelled_walks
from ltvn_core.types import Observation

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData, FineTuningPlan
    from ltvn_core.training_data.trajectory_pairs import LabelRule, TrajectoryPairs


def fine_tune_for_system(
    system: str,
    observations: Sequence[Observation],
    start: Path,
    plan: "FineTuningPlan",
    folder: Path,
    output: Path,
    *,
    camera: CameraModel | None = None,
    data: Path | None = None,
) -> Path:
    """Fine-tune weights on a drive by a system's own labels, and return where they lie.

    The rivals learn by time alone, beside random walks that carry the same labels; no confusions are mined for them.
    Weights of the very same run are not made twice. `folder` holds the checkpoint meanwhile: a call that was killed
    goes on from there. `data` names a folder of simulated scenes; without one, they come from the user's cache, which
    `render_training_scenes` fills beforehand, so that several processes need not all render them. Raises
    RecordingError, DatasetError and WeightsError.
    """
    from ltvn_core.network.optimization.baseline_plans import baseline_fine_tuning_plan
    from ltvn_core.network.optimization.fine_tuning_loop import run_fine_tuning
    from ltvn_core.network.weights_file import read_card

    drive = label_drive(observations, output.stem, camera=camera or LOCOBOT.camera, rule=_label_rule(system))
    lessons = _add_training_data(system, drive, data, with_validation_drives=plan.judge)
    plan = plan if system == "ltvn" else baseline_fine_tuning_plan(system, plan)
    run = _run_identity(system, lessons, start, plan)
    if _is_done(output, run):
        return output
    result = run_fine_tuning(lessons, start, plan, folder)
    assert result is not None  # Nobody cancels here.
    FineTuningProvenance(read_card(start), output.stem, run, f"finetune_for {system}").save(
        result, output, plan, lessons
    )
    rmtree(folder, ignore_errors=True)
    return output


def render_training_scenes(system: str, data: Path | None = None) -> None:
    """Render the simulated scenes that a system sees beside a drive, once for all processes. Raises DatasetError."""
    if system != "ltvn":
        labelled_walks(system, (*REHEARSAL_SCENES, *CALIBRATION_SCENES), _walks_folder(data))
    elif data is None:
        render_simulation()


def _label_rule(system: str) -> "LabelRule":
    from ltvn_core.training_data.temporal_rules import TEMPORAL_RULES
    from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule

    return OdometryLabelRule() if system == "ltvn" else TEMPORAL_RULES[system]


def _add_training_data(
    system: str, drive: "TrajectoryPairs", data: Path | None, *, with_validation_drives: bool
) -> "FineTuningData":
    """Add simulated pairs to a drive, labelled as the system does it."""
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData

    if system == "ltvn":
        return add_simulated_pairs(drive, data, with_validation_drives=with_validation_drives)
    walks = labelled_walks(system, (*REHEARSAL_SCENES, *CALIBRATION_SCENES), _walks_folder(data))
    return FineTuningData(drive, walks[: len(REHEARSAL_SCENES)], walks[len(REHEARSAL_SCENES) :])


def _walks_folder(data: Path | None) -> Path:
    from platformdirs import user_cache_path

    return (data or user_cache_path("ltvn")) / "walks"


def _run_identity(system: str, lessons: "FineTuningData", start: Path, plan: "FineTuningPlan") -> dict[str, object]:
    """Return what tells this run from others."""
    from ltvn_core.network.optimization.fine_tuning_loop import trajectory_fingerprint
    from ltvn_core.network.weights_file import weights_fingerprint

    return {
        "system": system,
        "parent": weights_fingerprint(start),
        "drive": trajectory_fingerprint(lessons.drive),
        "simulated": [scene.name for scene in lessons.scenes],
        "plan": asdict(plan),
    }


def _is_done(output: Path, run: dict[str, object]) -> bool:
    """Tell whether the output is of this very run. Raises WeightsError if it is something else."""
    from ltvn_core.network.weights_file import matching_card

    if not output.exists():
        return False
    if matching_card(output).get("run") != run:
        raise WeightsError(
            f"{output} exists and was made otherwise; nothing is overwritten. Name another output, or move that away."
        )
    return True
