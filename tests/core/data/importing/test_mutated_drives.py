"""Drives of other programs with damage in them: imported or refused with a message, and nothing else is touched."""

import json
from pathlib import Path

import pytest

from ltvn_core.cameras.camera_model import CameraModel
from tests.core.data.importing.drives import write_tum_folder
from tests.core.data.importing.lerobot import dataset_examples
from tests.core.data.importing.mutations import Fate, judge_mutations
from tests.core.data.importing.rosbag import bag_examples
from tests.core.data.importing.rtabmap import database_examples
from tests.core.data.importing.test_euroc_reader import write_sequence
from tests.core.data.importing.test_file_drives import write_colmap, write_nerfstudio, write_record3d, write_stray
from tests.core.data.importing.test_opennavmap_reader import write_map
from tests.core.data.importing.test_video_reader import write_video
from tests.core.data.importing.test_vint_reader import write_folder


def write_drives(folder: Path) -> Path:
    """Write a small drive in each format."""
    folder.mkdir()
    lens = CameraModel.from_fov(64, 48, 1.2).to_json()
    (write_tum_folder(folder / "tum") / "camera.json").write_text(json.dumps(lens), encoding="utf-8")
    dataset_examples.write_dataset(folder / "lerobot", [4])
    dataset_examples.write_dataset_v2(folder / "lerobot2", [4])
    write_sequence(folder / "euroc")
    for kind in ("mcap", "sqlite3", "bag"):
        bag_examples.straight_drive(folder / (f"ros1.{kind}" if kind == "bag" else kind), kind, frames=4)
    database_examples.write_database(folder / "rtabmap.db", database_examples.straight_drive())
    write_map(folder / "opennavmap")
    write_video(folder / "phone.mp4")
    write_folder(folder / "vint")
    write_stray(folder / "stray")
    write_nerfstudio(folder / "nerfstudio")
    write_record3d(folder / "walk.r3d")
    write_colmap(folder / "colmap")
    return folder


@pytest.mark.slow
def test_a_damaged_drive_is_imported_or_refused_and_nothing_else_is_touched(tmp_path: Path) -> None:
    drives = write_drives(tmp_path / "drives")
    judged = list(judge_mutations(drives, tmp_path / "scratch", seed=5, first=0, count=60))
    assert [each for each in judged if each.fate not in (Fate.IMPORTED, Fate.REFUSED)] == []
    assert len({each.fate for each in judged}) == 2
