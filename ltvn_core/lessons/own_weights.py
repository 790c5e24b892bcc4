"""Weights that know one drive, for each system of the comparison, without a person who waits for them.

Owns which labels, simulated pairs and plan each system takes. Learning is `ltvn_core.model.finetuning`; for one's own
recordings there is `ltvn finetune`.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING

from ltvn_core.composition import SystemName
from ltvn_core.errors import WeightsError
from ltvn_core.lessons.card import LessonCard
from ltvn_core.lessons.data import CHECKED, MIXED, label_drive, render_simulation, with_simulation
from ltvn_core.lessons.walks import labelled_walks
from ltvn_core.types import Intrinsics, Observation

if TYPE_CHECKING:
    from ltvn_core.data.trajectory_pairs import DriveRule, TrajectoryPairs
    from ltvn_core.model.finetuning import FineTuningData, FineTuningPlan


def finetune_for(
    system: SystemName,
    observations: Sequence[Observation],
    start: Path,
    plan: "FineTuningPlan",
    folder: Path,
    output: Path,
    *,
    camera: Intrinsics | None = None,
    data: Path | None = None,
) -> Path:
    """Fine-tune weights on a drive by a system's own labels, and return where they lie.

    The rivals learn by time alone, beside random walks that carry the same labels; no confusions are mined for them.
    Weights of the very same run are not made twice. `folder` holds the checkpoint meanwhile: a call that was killed
    goes on from there. `data` names a folder of simulated scenes; without one, they come from the user's cache, which
    `prepare_lessons` fills beforehand, so that several processes need not all render them. Raises RecordingError,
    DatasetError and WeightsError.
    """
    from ltvn_core.model.finetuning import finetune
    from ltvn_core.model.rival_plan import rival_finetuning
    from ltvn_core.model.weights import read_card

    drive = label_drive(observations, output.stem, camera=camera or Intrinsics(), rule=_rule(system))
    lessons = _with_lessons(system, drive, data, judged=plan.judge)
    plan = plan if system == "ltvn" else rival_finetuning(system, plan)
    run = _run(system, lessons, start, plan)
    if _is_done(output, run):
        return output
    result = finetune(lessons, start, plan, folder)
    assert result is not None  # Nobody cancels here.
    LessonCard(read_card(start), output.stem, run, f"finetune_for {system}").save(result, output, plan, lessons)
    rmtree(folder, ignore_errors=True)
    return output


def prepare_lessons(system: SystemName, data: Path | None = None) -> None:
    """Render the simulated scenes that a system sees beside a drive, once for all processes. Raises DatasetError."""
    if system != "ltvn":
        labelled_walks(system, (*MIXED, *CHECKED), _walks(data))
    elif data is None:
        render_simulation()


def _rule(system: SystemName) -> "DriveRule":
    from ltvn_core.data.temporal_rules import RULES
    from ltvn_core.data.trajectory_pairs import PairRule

    return PairRule() if system == "ltvn" else RULES[system]


def _with_lessons(system: SystemName, drive: "TrajectoryPairs", data: Path | None, *, judged: bool) -> "FineTuningData":
    """Add simulated pairs to a drive, labelled as the system does it."""
    from ltvn_core.model.finetuning import FineTuningData

    if system == "ltvn":
        return with_simulation(drive, data, judged=judged)
    walks = labelled_walks(system, (*MIXED, *CHECKED), _walks(data))
    return FineTuningData(drive, walks[: len(MIXED)], walks[len(MIXED) :])


def _walks(data: Path | None) -> Path:
    from platformdirs import user_cache_path

    return (data or user_cache_path("ltvn")) / "walks"


def _run(system: SystemName, lessons: "FineTuningData", start: Path, plan: "FineTuningPlan") -> dict[str, object]:
    """Return what tells this run from others."""
    from ltvn_core.model.finetuning import drive_fingerprint
    from ltvn_core.model.weights import weights_fingerprint

    return {
        "system": system,
        "parent": weights_fingerprint(start),
        "drive": drive_fingerprint(lessons.drive),
        "simulated": [scene.name for scene in lessons.scenes],
        "plan": asdict(plan),
    }


def _is_done(output: Path, run: dict[str, object]) -> bool:
    """Tell whether the output is of this very run. Raises WeightsError if it is something else."""
    from ltvn_core.model.weights import own_card

    if not output.exists():
        return False
    if own_card(output).get("run") != run:
        raise WeightsError(
            f"{output} exists and was made otherwise; nothing is overwritten. Name another output, or move that away."
        )
    return True
