"""A drive with another camera becomes a map, and whoever compares its images sees them with a camera of its own."""

from pathlib import Path

import pytest

import ltvn_core as ltvn
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError
from ltvn_core.network.architecture import NETWORK_CAMERA
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule
from ltvn_core.training.fine_tuning_data import read_labelled_drive
from ltvn_core.verbs.build import BuildSummary, BuildVerb
from tests.core.predictors.foreign_drive import CAMERA, write_foreign_drive

IMAGES = 8


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_foreign_drive(tmp_path_factory.mktemp("foreign") / "tour.rrd", IMAGES)


def built(drive: Path, output: Path, predictor: str) -> BuildSummary:
    summary = BuildVerb(recordings=(drive,), output=output, predictor=predictor).run()
    assert isinstance(summary, BuildSummary)
    return summary


def test_an_imported_drive_becomes_a_map_that_opens_with_what_made_it_and_nothing_else(
    drive: Path, tmp_path: Path
) -> None:
    path = tmp_path / "map.rrd"
    summary = built(drive, path, "auto")
    assert (summary.predictor, summary.predictor_reason) == ("geometric", "the drive was imported")
    assert (summary.frames, summary.nodes > 1) == (IMAGES, True)

    opened, meta = ltvn.TopologicalMap.load(path), Recording.open(path).meta

    assert (opened.predictor.camera, meta.camera, meta.config["predictor"]) == (CAMERA, CAMERA, "geometric")
    assert opened.predictor.fingerprint == meta.fingerprint
    node = opened.keyframes.observation(next(iter(opened.graph.nodes)))
    assert node.rgb.shape == (CAMERA.height, CAMERA.width, 3)
    with pytest.raises(MapError, match=r"by the predictor geometric .* --predictor geometric"):
        ltvn.TopologicalMap.load(path, ltvn.open_predictor())


def test_the_network_builds_from_the_same_drive_through_its_own_camera(drive: Path, tmp_path: Path) -> None:
    summary = built(drive, tmp_path / "map.rrd", "network")
    assert (summary.predictor, summary.predictor_reason) == ("network", "as asked")

    recording = Recording.open(tmp_path / "map.rrd")

    camera = recording.meta.camera
    assert (camera.width, camera.fx, camera.height_m) == (NETWORK_CAMERA.width, NETWORK_CAMERA.fx, CAMERA.height_m)
    assert recording.observation(recording.frames[0]).rgb.shape == (NETWORK_CAMERA.height, NETWORK_CAMERA.width, 3)


def test_fine_tuning_learns_from_images_as_the_network_sees_them(tmp_path: Path) -> None:
    drive = write_foreign_drive(tmp_path / "longer.rrd", 22)
    labelled = read_labelled_drive(drive, OdometryLabelRule(horizon=5, gated=False))
    assert labelled.rgb.shape[1:] == (NETWORK_CAMERA.height, NETWORK_CAMERA.width, 3)
