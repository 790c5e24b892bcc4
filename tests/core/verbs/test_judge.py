"""`ltvn judge` gives its figures as JSON, and says what a recording or an option lacks."""

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.evaluation.predictor_accuracy.judged_sequence import encode_sequence, read_sequence
from ltvn_core.types import Observation, Predictor
from ltvn_core.verbs.judge import JudgeVerb
from ltvn_core.verbs.verb import to_json
from tests.core.evaluation.judged_drive import ShiftedPredictor, drive, knowing_predictor
from tests.repository import ROOT
from tools.judgement_table import judgement_table

CONTRACT = {
    "auc", "near_recall", "far_fpr", "waypoint_median_m", "waypoint_p90_m", "yaw_median_deg", "ece", "nodes", "edges",
    "pieces", "largest_piece_share", "localised_share", "wrong_place_share",
}  # fmt: skip


def record(path: Path, seen: Iterable[Observation]) -> Path:
    with RecordingWriter(path, scene="room", config={}, fingerprint="") as writer:
        for each in seen:
            writer.write_frame(each)
    return path


def without_truth(observations: Iterable[Observation]) -> list[Observation]:
    return [replace(seen, exact_pose=None) for seen in observations]


def read(path: Path, predictor: Predictor, *, most: int = 2000, with_truth: bool = True) -> object:
    return read_sequence(Recording.open(path), predictor, most=most, with_truth=with_truth, progress=lambda done: None)


def test_a_simulated_drive_is_judged() -> None:
    pytest.importorskip("embreex")
    verb = JudgeVerb(
        recording=ROOT / "recordings" / "demo-drive.rrd",
        predictor="oracle",
        images=120,
        pairs=300,
    )
    summary = json.loads(to_json(verb.run()))
    assert summary.keys() >= CONTRACT
    assert summary["auc"] == 1
    assert summary["far_fpr"] == 0
    assert summary["images"] == 120
    assert summary["skipped"] > 0
    lines = judgement_table([summary]).markdown().splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| demo-drive"]


def test_a_recording_without_true_poses_is_refused_with_what_is_possible_instead(tmp_path: Path) -> None:
    path = record(tmp_path / "real.rrd", without_truth(drive()))
    with pytest.raises(RecordingError, match="--without-truth"):
        read(path, ShiftedPredictor())


def test_images_without_a_true_pose_are_left_out_and_counted(tmp_path: Path) -> None:
    seen = drive()
    path = record(tmp_path / "partly.rrd", [*without_truth(seen[:10]), *seen[10:]])
    images = read_sequence(
        Recording.open(path), knowing_predictor(), most=2000, with_truth=True, progress=lambda done: None
    )
    assert (len(images.observations), images.without_truth) == (len(seen) - 10, 10)
    assert len(encode_sequence(knowing_predictor(), images.observations, lambda done: None)) == len(seen) - 10


def test_a_long_recording_is_read_at_even_steps(tmp_path: Path) -> None:
    seen = drive()
    path = record(tmp_path / "long.rrd", seen)
    images = read_sequence(
        Recording.open(path), knowing_predictor(), most=20, with_truth=True, progress=lambda done: None
    )
    assert (len(images.observations), images.skipped) == (20, len(seen) - 20)
    assert images.observations[-1].step == seen[-1].step


def test_a_predictor_that_needs_depth_says_so_of_a_recording_without(tmp_path: Path) -> None:
    class Deep(ShiftedPredictor):
        needs_depth = True

    path = record(tmp_path / "colours.rrd", [replace(seen, depth=None) for seen in drive()])
    with pytest.raises(RecordingError, match=r"0 of the .* images of .* have depth, which the predictor needs"):
        read(path, Deep())


def test_a_recording_of_one_image_cannot_be_judged(tmp_path: Path) -> None:
    path = record(tmp_path / "one.rrd", drive()[:1])
    with pytest.raises(RecordingError, match="1 images; at least two"):
        read(path, ShiftedPredictor())


@pytest.mark.parametrize(
    ("verb", "message"),
    [
        (JudgeVerb(recording=Path("a.rrd"), left_out=1.0), "--left-out must lie between 0 and 1"),
        (JudgeVerb(recording=Path("a.rrd"), pairs=0), "--pairs must be 1 or more"),
    ],
)
def test_options_that_cannot_be_are_refused_first(verb: JudgeVerb, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        verb.run()
