"""`python -m figures.drive_pictures` draws a drive and its map."""

from pathlib import Path

import cv2

from figures.drive_pictures import COLUMNS, SIZE, DrivePicturesSummary, DrivePicturesVerb
from tests.core.data.recording import example_recording


def test_a_drive_with_its_depth_and_the_nodes_of_its_map_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    example_recording.write(path)
    summary = DrivePicturesVerb(recording=path, map=path, output=tmp_path / "pictures").run()
    assert isinstance(summary, DrivePicturesSummary)
    drive, nodes = (cv2.imread(str(picture)) for picture in summary.pictures)
    assert drive is not None
    assert nodes is not None
    assert drive.shape[0] > 2 * SIZE[1]
    assert drive.shape[1] > COLUMNS * SIZE[0]
    assert nodes.shape[0] == SIZE[1]
