"""Weights that know one drive, for each system of the comparison, without a person who waits for them.

Owns which labels, simulated pairs and plan each system takes. Learning is `ltvn_core.model.finetuning`; for one's own
recordings there is `ltvn finetune`.
"""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Literal, TypeAlias

from ltvn_core.errors import WeightsError
from ltvn_core.types import Intrinsics, Observation
from ltvn_core.verbs.lesson_card import LessonCard
from ltvn_core.verbs.lesson_data import label_drive, render_simulation, with_simulation

if TYPE_CHECKING:
    from ltvn_core.model.finetuning import FineTuningData, FineTuningPlan

System: TypeAlias = Literal["ltvn", "sptm", "ving"]
"""Systems that learn from a drive, each by labels of its own."""


def finetune_for(
    system: System,
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

    Weights of the very same run are not made twice. `folder` holds the checkpoint meanwhile: a call that was killed
    goes on from there. `data` names a folder of simulated scenes; without one, they come from the user's cache, which
    `prepare_lessons` must have filled before several processes call this at once. Raises RecordingError, DatasetError
    and WeightsError.
    """
    from ltvn_core.model.finetuning import finetune
    from ltvn_core.model.weights import read_card

    lessons = _lessons(system, observations, output.stem, camera or Intrinsics(), data, judged=plan.judge)
    run = _run(system, lessons, start, plan)
    if _is_done(output, run):
        return output
    result = finetune(lessons, start, plan, folder)
    assert result is not None  # Nobody cancels here.
    LessonCard(read_card(start), output.stem, run, f"finetune_for {system}").save(result, output, plan, lessons)
    rmtree(folder, ignore_errors=True)
    return output


def prepare_lessons(system: System) -> None:
    """Render the simulated pairs that a system learns beside a drive, once for all processes. Raises DatasetError."""
    render_simulation()


def _lessons(
    system: System,
    observations: Sequence[Observation],
    name: str,
    camera: Intrinsics,
    data: Path | None,
    *,
    judged: bool,
) -> "FineTuningData":
    from ltvn_core.data.trajectory_pairs import PairRule

    return with_simulation(label_drive(observations, name, camera=camera, rule=PairRule()), data, judged=judged)


def _run(system: System, lessons: "FineTuningData", start: Path, plan: "FineTuningPlan") -> dict[str, object]:
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
