"""`ltvn finetune` says what a recording, a folder or an option lacks, and overwrites nothing."""

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.drive_part import DrivePart
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import DatasetError, OptionError, RecordingError, WeightsError
from ltvn_core.evaluation.predictor_accuracy.judged_sequence import read_sequence
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule
from ltvn_core.predictors.geometric_evidence import shipped_calibration
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.training.fine_tuning_data import RehearsalData, ignore_progress, read_labelled_drive
from ltvn_core.types import Observation
from ltvn_core.verbs.finetune import FinetuneVerb
from ltvn_core.verbs.verb import to_json
from tests.core.network.training_data.example_drive import observations_at, poses_along
from tests.core.predictors.textured_room import TexturedRoom

WITHOUT_TORCH = """
import sys
from ltvn_core.cli import main

class NoTorch:
    def find_spec(self, name, *_):
        if name == "torch":
            raise ModuleNotFoundError(name=name)

sys.meta_path.insert(0, NoTorch())
sys.exit(main(sys.argv[1:]))
"""
WAY = poses_along((1.0, 1.0), (3.2, 1.0), (3.2, 3.3))


def record(path: Path, seen: Iterable[Observation]) -> Path:
    with RecordingWriter(path, scene="box", config={}, fingerprint="") as writer:
        for each in seen:
            writer.write_frame(each)
    return path


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return record(tmp_path / "drive.rrd", observations_at(WAY))


def test_a_recording_becomes_labelled_pairs(recording: Path) -> None:
    drive = read_labelled_drive(recording, OdometryLabelRule(horizon=8))
    assert drive.name == "drive.rrd"
    assert len(drive.poses) == len(WAY)
    assert 0.1 < drive.reachable.mean() < 0.9


def test_a_dataset_folder_that_holds_nothing_is_named(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"nowhere: needs shards .* run `ltvn dataset --folder"):
        RehearsalData(tmp_path / "nowhere").load(
            read_labelled_drive(recording, OdometryLabelRule(horizon=8)), ignore_progress, with_validation_drives=False
        )


def test_the_calibration_of_the_geometric_predictor_needs_no_torch(tmp_path: Path) -> None:
    arguments = ["finetune", "gone.rrd", "--output", "tuned.json", "--predictor", "geometric"]
    ran = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH, *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert "no file gone.rrd" in ran.stderr


def test_an_output_of_another_run_stays(recording: Path, tmp_path: Path) -> None:
    output = tmp_path / "tuned.safetensors"
    output.write_bytes(b"precious")
    with pytest.raises(WeightsError, match="not overwritten"):
        FinetuneVerb(recording=recording, output=output).run()
    assert output.read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"part": "3/2"}, "--part is"),
        ({"predictor": "geometric"}, "must end in .json"),
        ({"horizon": 1}, "--horizon must be 2"),
        ({"minutes": 0.0}, "--minutes must be above"),
        ({}, "must end in"),
    ],
)
def test_an_option_without_sense_is_refused(recording: Path, tmp_path: Path, options: dict, said: str) -> None:
    output = tmp_path / ("tuned.safetensors" if options else "tuned.pt")
    with pytest.raises(OptionError, match=said):
        FinetuneVerb(recording=recording, output=output, **options).run()


def test_a_part_of_a_drive_teaches_alone(recording: Path) -> None:
    drive = read_labelled_drive(recording, OdometryLabelRule(horizon=8), DrivePart(1, 2))
    assert len(drive.poses) == len(WAY) // 2


def small_drive(path: Path, images: int) -> Path:
    """A drive along a room with patterns, through a camera so small that pairs are quickly compared."""
    room, camera = TexturedRoom(3), CameraModel.from_fov(96, 72, 1.2, height_m=0.45)
    with RecordingWriter(
        path, scene="a real house", config={"verb": "import"}, fingerprint="", camera=camera
    ) as writer:
        for step in range(images):
            writer.write_frame(room.observe(np.array([0.5 + 0.08 * step, 2.0, 0.1 * np.sin(step / 3)]), step, camera))
    return path


def test_a_calibration_learns_from_half_a_drive_and_compares_images_afterwards(tmp_path: Path) -> None:
    drive = small_drive(tmp_path / "drive.rrd", 40)
    output = tmp_path / "own.json"
    verb = FinetuneVerb(recording=drive, predictor="geometric", part="1/2", output=output)
    found = json.loads(to_json(verb.run()))
    assert (found["images"], found["poses"]) == (20, "odometry")
    assert found["after"]["near_recall"] >= found["before"]["near_recall"]
    assert found["after"]["far_fpr"] <= found["before"]["far_fpr"]
    card = json.loads(output.read_text(encoding="utf-8"))["card"]
    assert card["command"] == "ltvn finetune drive.rrd --output own.json --predictor geometric --part 1/2 --seed 0"
    assert card["parent"] == shipped_calibration().fingerprint
    recording = Recording.open(drive)
    predictor = open_predictor("geometric", weights=output, camera=recording.meta.camera)
    rest = read_sequence(
        recording, predictor, most=99, with_truth=False, progress=lambda done: None, part=DrivePart(2, 2)
    )
    assert [seen.step for seen in rest.observations] == list(range(20, 40))
    answers = predictor.predict(predictor.encode(rest.observations[:1]), predictor.encode(rest.observations[1:2]))
    assert answers.reachability[0] > 0.5
    with pytest.raises(RecordingError, match="exists already"):
        verb.run()


def test_a_drive_that_nobody_knows_the_way_of_teaches_no_calibration(tmp_path: Path) -> None:
    path = record(tmp_path / "still.rrd", observations_at(WAY, WAY * 0))
    with pytest.raises(RecordingError, match="ground truth or odometry"):
        FinetuneVerb(recording=path, predictor="geometric", output=tmp_path / "own.json").run()
