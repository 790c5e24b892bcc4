"""`ltvn finetune` says what a recording, a folder or an option lacks, and overwrites nothing."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from ltvn_core.errors import DatasetError, OptionError, RecordingError, WeightsError
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.training.fine_tuning_data import SimulatedPairs, ignore_progress, read_labelled_drive
from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule
from ltvn_core.types import Observation, Pose
from ltvn_core.verbs.finetune import FinetuneVerb
from tests.core.training_data.example_drive import observations_at, poses_along

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


def test_odometry_with_a_jump_is_taken_in_pieces(tmp_path: Path) -> None:
    jumping: Pose = WAY.copy()
    jumping[20:, 0] += 4
    drive = read_labelled_drive(
        record(tmp_path / "jump.rrd", observations_at(WAY, jumping)), OdometryLabelRule(horizon=8)
    )
    assert drive.trajectory.pieces == 2


def test_a_recording_of_one_place_or_of_nothing_much_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="holds 6 images; fine-tuning needs 20"):
        read_labelled_drive(record(tmp_path / "short.rrd", observations_at(WAY[:6])), OdometryLabelRule(horizon=8))
    with pytest.raises(RecordingError, match="the same for all of them"):
        read_labelled_drive(record(tmp_path / "still.rrd", observations_at(WAY, WAY * 0)), OdometryLabelRule(horizon=8))


def test_a_dataset_folder_that_holds_nothing_is_named(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"nowhere: needs shards .* run `ltvn dataset --folder"):
        SimulatedPairs(tmp_path / "nowhere").load(
            read_labelled_drive(recording, OdometryLabelRule(horizon=8)), ignore_progress, with_validation_drives=False
        )


def test_an_output_of_another_run_stays(recording: Path, tmp_path: Path) -> None:
    output = tmp_path / "tuned.safetensors"
    output.write_bytes(b"precious")
    with pytest.raises(WeightsError, match="nothing is overwritten"):
        FinetuneVerb(recording=recording, output=output).run()
    assert output.read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("options", "said"),
    [({"horizon": 1}, "--horizon must be 2"), ({"minutes": 0.0}, "--minutes must be above"), ({}, "must end in")],
)
def test_an_option_without_sense_is_refused(recording: Path, tmp_path: Path, options: dict, said: str) -> None:
    output = tmp_path / ("tuned.safetensors" if options else "tuned.pt")
    with pytest.raises(OptionError, match=said):
        FinetuneVerb(recording=recording, output=output, **options).run()
