"""Data sets in LeRobot's versions 2 and 3 come out as frames; damaged and hostile ones end in one clear error."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ltvn_core.data.importing.lerobot.dataset import rows_at_once
from ltvn_core.data.importing.lerobot_reader import LerobotReader
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.errors import DriveError
from tests.core.data.importing.lerobot.dataset_examples import (
    DEPTH,
    FRONT,
    HEIGHT,
    STATE,
    WIDTH,
    colours,
    poses,
    write_dataset,
    write_dataset_v2,
    write_episodes,
)
from tests.platforms import needs_posix


def read(path: Path, options: ReadOptions | None = None) -> tuple[list[RawFrame], LerobotReader]:
    reader = LerobotReader.open(path, options or ReadOptions())
    return list(reader.frames()), reader


def test_the_unit_of_depth_images_can_be_said(tmp_path: Path) -> None:
    path = write_dataset(tmp_path / "set", as_video=False, depth=True)

    whole, halved = (read(path, ReadOptions(depth_unit_m=unit))[0][0].depth_m for unit in (0.001, 0.0005))

    assert whole is not None
    assert halved is not None
    assert np.allclose(halved, whole / 2)


@pytest.mark.parametrize("as_video", [True, False])
def test_an_episode_becomes_frames_with_depth_and_odometry(tmp_path: Path, as_video: bool) -> None:
    frames, reader = read(write_dataset(tmp_path / "set", as_video=as_video, depth=True))

    assert LerobotReader.recognises(tmp_path / "set")
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5], abs=1e-6)
    assert np.allclose(np.array([frame.odometry for frame in frames], float), poses(6), atol=1e-6)
    for number, frame in enumerate(frames):
        assert np.abs(frame.rgb.astype(int) - colours(number)).mean() < (6 if as_video else 0.1)
        assert frame.depth_m is not None
        assert frame.depth_m.shape == (HEIGHT, WIDTH)
        assert np.allclose(frame.depth_m, 1 + 0.25 * number, atol=0.003)
    assert {stream.role: stream.name for stream in reader.facts.streams} == {
        "rgb": FRONT,
        "depth": DEPTH,
        "odometry": STATE,
    }
    assert not reader.dropped


def test_of_several_episodes_the_longest_is_read(tmp_path: Path) -> None:
    frames, reader = read(write_dataset(tmp_path / "set", (2, 5, 3)))

    assert len(frames) == 5
    # Its images begin behind those of the first episode.
    assert np.abs(frames[0].rgb.astype(int) - colours(2)).mean() < 6
    assert np.abs(frames[4].rgb.astype(int) - colours(6)).mean() < 6
    assert reader.dropped == {"of another episode": 5}
    assert "number 1" in reader.doubts[0]


def test_velocities_are_no_poses(tmp_path: Path) -> None:
    features = {
        FRONT: {"dtype": "video", "shape": [HEIGHT, WIDTH, 3]},
        STATE: {"dtype": "float32", "shape": [3], "names": {"motors": ["x.vel", "y.vel", "theta.vel"]}},
    }

    frames, _ = read(write_dataset(tmp_path / "set", info={"features": features}))

    assert all(frame.odometry is None for frame in frames)
    with pytest.raises(DriveError, match="called x, y and yaw"):
        read(tmp_path / "set", ReadOptions(odometry=STATE))


def test_several_cameras_are_an_error_that_lists_them(tmp_path: Path) -> None:
    features = {key: {"dtype": "video", "shape": [HEIGHT, WIDTH, 3]} for key in ("images.left", "images.right")}

    with pytest.raises(DriveError, match=r"--rgb.*images\.left, images\.right"):
        read(write_dataset(tmp_path / "set", info={"features": features}))


@pytest.mark.parametrize("version", ["v1.6", "v4.0", "", None])
def test_a_version_that_is_not_read_is_named(tmp_path: Path, version: str | None) -> None:
    with pytest.raises(DriveError, match=r"2\.0, 2\.1 and 3"):
        read(write_dataset(tmp_path / "set", info={"codebase_version": version}))


@pytest.mark.parametrize("as_video", [True, False])
@pytest.mark.parametrize("version", ["v2.0", "v2.1"])
def test_the_longest_episode_of_version_2_becomes_frames(tmp_path: Path, as_video: bool, version: str) -> None:
    folder = write_dataset_v2(tmp_path / "set", (2, 3, 5), as_video=as_video, codebase_version=version)

    frames, reader = read(folder)

    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4], abs=1e-6)
    assert np.allclose(np.array([frame.odometry for frame in frames], float), poses(5), atol=1e-6)
    for step, frame in enumerate(frames):
        assert np.abs(frame.rgb.astype(int) - colours(2 + step)).mean() < (6 if as_video else 0.1)
    assert reader.dropped == {"of another episode": 5}


def test_images_in_files_beside_the_rows_are_read(tmp_path: Path) -> None:
    folder = write_dataset_v2(tmp_path / "set", (3,), as_video=False)
    file = folder / "data/chunk-000/episode_000000.parquet"
    table = pq.read_table(file)
    images = folder / f"images/{FRONT}/episode_000000"
    images.mkdir(parents=True)
    for step, cell in enumerate(table[FRONT].to_pylist()):
        (images / f"frame_{step:06d}.png").write_bytes(cell["bytes"])
    paths = pa.array([{"bytes": None, "path": f"frame_{step:06d}.png"} for step in range(3)])
    pq.write_table(table.drop_columns([FRONT]).append_column(FRONT, paths), file)

    assert len(read(folder)[0]) == 3
    outside = pa.array([{"bytes": None, "path": "/etc/passwd"}] * 3)
    pq.write_table(table.drop_columns([FRONT]).append_column(FRONT, outside), file)
    with pytest.raises(DriveError, match="outside"):
        read(folder)


@pytest.mark.parametrize(
    "info",
    [
        {"video_path": "../{video_key}.mp4"},
        {"data_path": "/etc/passwd"},
        {"data_path": "{episode_index.__class__}/data"},
        {"data_path": "{0.__init__.__globals__}"},
        {"chunks_size": 0},
        {"chunks_size": "many"},
    ],
)
def test_what_version_2_says_of_its_files_is_not_believed(tmp_path: Path, info: dict[str, Any]) -> None:
    with pytest.raises(DriveError) as caught:
        read(write_dataset_v2(tmp_path / "set", **info))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("lines", ["", "{}", "[" * 100_000, '{"episode_index": -1, "length": 5}', "\0\n"])
def test_a_list_of_episodes_that_is_none_ends_in_one_line(tmp_path: Path, lines: str) -> None:
    folder = write_dataset_v2(tmp_path / "set")
    (folder / "meta/episodes.jsonl").write_text(lines, encoding="utf-8")

    with pytest.raises(DriveError) as caught:
        read(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name", [f"videos/chunk-000/{FRONT}/episode_000000.mp4", "data/chunk-000/episode_000000.parquet"]
)
def test_files_that_git_lfs_keeps_are_named_so(tmp_path: Path, name: str) -> None:
    folder = write_dataset_v2(tmp_path / "set")
    (folder / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", encoding="utf-8")
    with pytest.raises(DriveError, match="git lfs pull"):
        read(folder)
    (folder / name).unlink()
    with pytest.raises(DriveError, match=r"lacks .*episode_000000.*Copy the whole"):
        read(folder)
    (folder / ".gitattributes").write_text("*.mp4 filter=lfs diff=lfs merge=lfs -text\n", encoding="utf-8")
    with pytest.raises(DriveError, match=r"lacks .*git lfs pull"):
        read(folder)


@pytest.mark.parametrize(
    "info",
    [
        {"video_path": "../{video_key}.mp4"},
        {"data_path": "/etc/passwd"},
        {"data_path": "{chunk_index.__class__}/data"},
        {"fps": 0},
        {"fps": float("nan")},
        {"features": [1, 2]},
        {"features": {FRONT: {"dtype": "video", "is_depth_map": True, "depth_min": -9.0}}},
    ],
)
def test_what_a_data_set_says_of_itself_is_not_believed(tmp_path: Path, info: dict[str, Any]) -> None:
    with pytest.raises(DriveError) as caught:
        read(write_dataset(tmp_path / "set", info=info))
    assert "\n" not in str(caught.value)


@needs_posix
def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    folder, other = write_dataset(tmp_path / "set"), write_dataset(tmp_path / "other")
    video = folder / "videos" / FRONT / "chunk-000/file-000.mp4"
    video.unlink()
    video.symlink_to(other / "videos" / FRONT / "chunk-000/file-000.mp4")

    with pytest.raises(DriveError, match="outside"):
        read(folder)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no video",
        b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n",
        b"ffconcat version 1.0\nfile /etc/passwd\n",
    ],
)
def test_a_video_that_is_none_ends_in_one_line(tmp_path: Path, content: bytes) -> None:
    folder = write_dataset(tmp_path / "set")
    (folder / "videos" / FRONT / "chunk-000/file-000.mp4").write_bytes(content)

    with pytest.raises(DriveError) as caught:
        read(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_cut_tables_end_in_one_line(tmp_path: Path, name: str, share: float) -> None:
    file = write_dataset(tmp_path / "set") / name
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * share)])

    with pytest.raises(DriveError) as caught:
        read(tmp_path / "set")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "changed",
    [
        {"data/file_index": [-1]},
        {"data/chunk_index": ["../.."]},
        {f"videos/{FRONT}/from_timestamp": [float("nan")]},
        {"length": [None]},
    ],
)
def test_what_is_said_of_an_episode_is_not_believed(tmp_path: Path, changed: dict[str, Any]) -> None:
    folder = write_dataset(tmp_path / "set")
    write_episodes(folder, (6,), **changed)

    with pytest.raises(DriveError):
        read(folder)


def with_states(folder: Path, states: pa.Array) -> Path:
    """Write a data set whose table holds something else in place of x, y and yaw."""
    file = write_dataset(folder, (6,), as_video=False) / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file).drop_columns([STATE]).append_column(STATE, states)
    pq.write_table(table, file, compression="zstd")
    return folder


def test_a_kilobyte_that_stands_for_millions_of_numbers_is_refused(tmp_path: Path) -> None:
    numbers = pa.ListArray.from_arrays(np.arange(7) * 200_000, np.zeros(1_200_000, np.float32))

    with pytest.raises(DriveError, match="1,200,000 values in 6 rows"):
        read(with_states(tmp_path / "set", numbers))


def test_rows_whose_images_could_be_large_are_read_a_few_at_a_time(tmp_path: Path) -> None:
    image = pa.array([bytes(20_000_000)], pa.binary())
    pq.write_table(pa.table({FRONT: pa.DictionaryArray.from_arrays([0] * 500, image)}), tmp_path / "bomb.parquet")

    assert (tmp_path / "bomb.parquet").stat().st_size < 2_000_000
    assert rows_at_once(pq.read_metadata(tmp_path / "bomb.parquet"), [FRONT]) == 13


@pytest.mark.parametrize("cell", [None, [], [0.0], ["north", "south", "west"]])
def test_states_that_are_no_numbers_leave_odometry_open(tmp_path: Path, cell: Any) -> None:
    frames, _ = read(with_states(tmp_path / "set", pa.array([cell] * 6)))

    assert [frame.odometry for frame in frames] == [None] * 6


@needs_posix
def test_a_pipe_in_place_of_a_table_is_never_waited_for(tmp_path: Path) -> None:
    file = write_dataset(tmp_path / "set") / "data/chunk-000/file-000.parquet"
    file.unlink()
    os.mkfifo(file)

    with pytest.raises(DriveError, match="a pipe or a device"):
        read(tmp_path / "set")


def test_a_video_that_ends_too_early_gives_what_it_has(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "set", (6,))
    write_episodes(folder, (6,), **{f"videos/{FRONT}/to_timestamp": [0.4]})

    frames, reader = read(folder)

    assert len(frames) == 4
    assert reader.dropped == {"damaged image": 2}
