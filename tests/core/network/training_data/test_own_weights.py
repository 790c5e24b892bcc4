"""Each system of the comparison gets weights that know one drive, once."""

import json
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest
import torch

from ltvn_core.errors import WeightsError
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan
from ltvn_core.network.optimization.trainer import Hyperparameters
from ltvn_core.network.training_data.pose_sampling import ClusterSampling
from ltvn_core.network.training_data.random_walk import WalkRecipe
from ltvn_core.network.training_data.shards import DatasetRecipe, shard_path, write_shard
from ltvn_core.network.weights_file import card_path, load_weights, read_card, save_weights, weights_fingerprint
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.fine_tuning import FineTunedWeights, FineTuningProvenance, FineTuningReporter, fine_tune
from ltvn_core.training.fine_tuning_data import CALIBRATION_SCENES, REHEARSAL_SCENES, SystemTraining, label_drive
from tests.core.network.tiny_data import SMALL
from tests.core.network.training_data.box_world import two_rooms
from tests.core.network.training_data.example_drive import observations_at, poses_along

WAY = poses_along((1.0, 1.0), (3.2, 1.0), (3.2, 3.3), (6.5, 3.3), (6.5, 1.0))
PLAN = FineTuningPlan(
    Hyperparameters(groups=4, confusions=1, hard=6, random=4, rate=1e-3), minutes=None, steps=2, minings=1, judge=False
)


@pytest.fixture
def start(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    save_weights(PairNetwork(SMALL), tmp_path / "start.safetensors")
    return tmp_path / "start.safetensors"


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    recipe = DatasetRecipe(clusters=6, sampling=ClusterSampling(size=6))
    for name in ("train-00", "tune-0"):
        write_shard(recipe.make(two_rooms(name)), shard_path(tmp_path / "data", name))
    return tmp_path / "data"


@pytest.fixture
def walks(tmp_path: Path) -> Path:
    for name in (*REHEARSAL_SCENES, *CALIBRATION_SCENES):
        walk = WalkRecipe(walks=1, images=48).make(two_rooms(name))
        write_shard(replace(walk, recipe=WalkRecipe().text()), shard_path(tmp_path / "data" / "walks", name))
    return tmp_path / "data"


def fine_tune_for(
    system: str,
    start: Path,
    output: Path,
    *,
    data: Path,
    plan: FineTuningPlan = PLAN,
    on_progress: FineTuningReporter | None = None,
    cancelled: Event | None = None,
) -> FineTunedWeights | None:
    """Fine-tune weights on the drive as the evaluation of a system does."""
    training = SystemTraining(system_entry(system).learning)
    return fine_tune(
        label_drive(observations_at(WAY), "scene-0", camera=LOCOBOT.camera, rule=training.label_rule()),
        training.rehearsal(data),
        start,
        output,
        training.adapt_plan(plan),
        provenance=FineTuningProvenance(recording="scene-0", system=system),
        work_folder=output.parent / "work",
        on_progress=on_progress,
        cancelled=cancelled,
    )


def test_weights_know_the_drive_and_keep_their_architecture(tmp_path: Path, start: Path, dataset: Path) -> None:
    output = tmp_path / "scene-0.safetensors"
    made = fine_tune_for("ltvn", start, output, data=dataset)
    assert made is not None
    assert made.weights == output
    assert weights_fingerprint(output) != weights_fingerprint(start)
    assert load_weights(output).size == SMALL
    card = read_card(output)
    assert (card["parent"], card["steps"], card["before"]) == (weights_fingerprint(start), 2, None)
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize("system", ["sptm", "ving"])
def test_a_baseline_learns_the_same_drive_by_time_alone(tmp_path: Path, start: Path, walks: Path, system: str) -> None:
    output = tmp_path / f"scene-0-{system}.safetensors"
    fine_tune_for(system, start, output, data=walks)
    assert weights_fingerprint(output) != weights_fingerprint(start)
    assert load_weights(output).size == SMALL
    card = read_card(output)
    assert (card["run"]["system"], card["run"]["simulated"]) == (system, list(REHEARSAL_SCENES))
    assert card["plan"]["minings"] == 0


@pytest.mark.slow
def test_the_same_weights_are_not_made_twice_and_others_not_overwritten(
    tmp_path: Path, start: Path, dataset: Path
) -> None:
    output = tmp_path / "scene-0.safetensors"
    first = fine_tune_for("ltvn", start, output, data=dataset)
    written = output.stat().st_mtime_ns
    assert fine_tune_for("ltvn", start, output, data=dataset) == first
    assert output.stat().st_mtime_ns == written
    with pytest.raises(WeightsError, match="is not overwritten"):
        fine_tune_for("ltvn", start, output, data=dataset, plan=replace(PLAN, steps=1))


def test_weights_whose_card_was_changed_are_refused(tmp_path: Path, start: Path, dataset: Path) -> None:
    output = tmp_path / "scene-0.safetensors"
    fine_tune_for("ltvn", start, output, data=dataset)
    card = read_card(output)
    for spoilt in ({**card, "steps": None, "before": 3}, {key: card[key] for key in ("fingerprint", "run")}):
        card_path(output).write_text(json.dumps(spoilt), encoding="utf-8")
        with pytest.raises(WeightsError, match="does not fit them"):
            fine_tune_for("ltvn", start, output, data=dataset)
    card_path(output).write_text(
        json.dumps(card | {"run": {"parent": card["parent"], "minutes": 3.0}}), encoding="utf-8"
    )
    with pytest.raises(WeightsError, match="other settings"):
        fine_tune_for("ltvn", start, output, data=dataset)


def test_cancelling_while_learning_leaves_nothing(tmp_path: Path, start: Path, dataset: Path) -> None:
    folder, cancelled = tmp_path / "new", Event()
    folder.mkdir()

    def cancel_at_the_first_step(_share: float, doing: str, _progress: object) -> None:
        if doing == "learning":
            cancelled.set()

    output = folder / "scene-0.safetensors"
    found = fine_tune_for(
        "ltvn", start, output, data=dataset, on_progress=cancel_at_the_first_step, cancelled=cancelled
    )
    assert found is None
    assert list(folder.iterdir()) == []
