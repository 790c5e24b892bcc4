"""A `map.yaml` of nav2 and its picture are read as the map server reads them, and laid under a map by points."""

import os
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.importing.floor_plan_alignment import align_floor_plan
from ltvn_core.errors import DriveError, OptionError
from ltvn_core.geometry import compose
from tests.core.data.importing.plan_files import SAID, room, write_plan, write_png

CELLS = np.zeros((4, 6), np.int8)
CELLS[0, 0], CELLS[0, 5] = 100, -1


def test_pixels_lie_where_the_map_server_puts_them(tmp_path: Path) -> None:
    plan = FloorPlan.open(write_plan(tmp_path))

    np.testing.assert_array_equal(plan.cells, CELLS)
    assert plan.size_m == (3.0, 2.0)
    rows, columns = np.mgrid[:4, :6].reshape(2, -1)
    middles = np.column_stack([-1.0 + 0.5 * (columns + 0.5), 2.0 + 0.5 * (4 - rows - 0.5)])
    np.testing.assert_array_equal(plan.cells_at(middles), CELLS.ravel())
    outside = [(-1.01, 2.5), (2.01, 2.5), (0, 1.99), (0, 4.01), (1e9, -1e9)]
    np.testing.assert_array_equal(plan.cells_at(outside), [-1] * 5)


def test_the_origin_may_be_turned(tmp_path: Path) -> None:
    plan = FloorPlan.open(write_plan(tmp_path, SAID.replace("2.0, 0]", f"2.0, {np.pi / 2}]")))

    # The wall, a quarter of a metre along x and 1.75 m along y of the picture, both turned to the left.
    assert plan.cells_at([(-1.0 - 1.75, 2.0 + 0.25)]).tolist() == [100]
    np.testing.assert_allclose(plan.middle, (-2.0, 3.5, np.pi / 2))


@pytest.mark.parametrize(
    ("lines", "cells"),
    [
        ({"negate: 0": "negate: 1"}, (0, 100, 100)),
        ({"trinary": "scale"}, (100, 0, 0)),
        ({"trinary": "scale", "free_thresh: 0.196": "free_thresh: 0.0"}, (100, 30, 1)),
        ({"trinary": "raw"}, (0, -1, -1)),
    ],
    ids=["negate", "scale", "scale from 0", "raw"],
)
def test_brightness_means_what_the_file_says(
    tmp_path: Path, lines: dict[str, str], cells: tuple[int, int, int]
) -> None:
    said = SAID
    for line, other in lines.items():
        said = said.replace(line, other)
    plan = FloorPlan.open(write_plan(tmp_path, said))

    assert (plan.cells[0, 0], plan.cells[0, 5], plan.cells[1, 1]) == cells


def test_png_plain_pgm_comments_and_lists_by_lines_are_read(tmp_path: Path) -> None:
    write_plan(tmp_path)
    write_png(tmp_path)
    rows = "\n".join(" ".join(map(str, row)) for row in room().tolist())
    (tmp_path / "plain map.pgm").write_text(f"P2\n6 4\n255\n{rows}\n", encoding="utf-8")
    listed = SAID.replace("origin: [-1.0, 2.0, 0]", "origin:\n- -1.0  # x\n- 2.0\n- 0.0")
    for name in ("map.png", '"plain map.pgm"', str(tmp_path / "map.png")):
        (tmp_path / "map.yaml").write_text(listed.replace("map.pgm", name), encoding="utf-8")
        plan = FloorPlan.open(tmp_path / "map.yaml")
        np.testing.assert_array_equal(plan.cells, CELLS)
        np.testing.assert_array_equal(plan.corner, (-1.0, 2.0, 0.0))


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (SAID.replace("image: map.pgm", "picture: map.pgm"), "names no image"),
        (SAID.replace("map.pgm", "other.pgm"), r"other\.pgm cannot be read"),
        (SAID.replace("map.pgm", "../map.pgm"), "lies outside"),
        (SAID.replace("map.pgm", "/etc/hostname"), "lies outside"),
        (SAID.replace("map.pgm", "map.yaml"), "not an image"),
        (SAID.replace("map.pgm", "big.pgm"), "64,000,000 pixels"),
        (SAID.replace("0.5", "0", 1), "resolution must"),
        (SAID.replace("0.5", "-0.05", 1), "resolution must"),
        (SAID.replace("0.5", "fine", 1), "resolution must be a number"),
        (SAID.replace("0.5", "nan", 1), "resolution must be a finite number"),
        (SAID.replace("0.5", "90000", 1), "check resolution"),
        (SAID.replace("-1.0, 2.0, 0", "1, 2"), "origin is"),
        (SAID.replace("-1.0, 2.0, 0", "1, 2, inf"), "not finite"),
        (SAID.replace("-1.0, 2.0, 0", "1, 2, 1e300"), "origin is"),
        (SAID.replace("negate: 0", "negate: perhaps"), "negate is 0 or 1"),
        (SAID.replace("trinary", "colourful"), "trinary, scale, raw"),
        (SAID.replace("0.196", "0.7"), "must be below"),
        ("[" * 90_000, "names no image"),
        ("&a [*a, *a]\n" * 5_000, "names no image"),
        ("#" * 200_000, "100,000 bytes"),
        (SAID.replace("map.pgm", "\0"), "cannot be"),
    ],
)
def test_what_cannot_be_right_is_refused_in_one_line(tmp_path: Path, said: str, expected: str) -> None:
    path = write_plan(tmp_path, said)
    (tmp_path / "big.pgm").write_bytes(b"P5\n20000 20000\n255\n" + b"0" * 100)

    with pytest.raises(DriveError, match=expected) as caught:
        FloorPlan.open(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".pgm", ".PNG"])
def test_the_picture_in_place_of_its_yaml_is_refused_with_lines_that_make_one(tmp_path: Path, suffix: str) -> None:
    picture = tmp_path / f"house{suffix}"
    cv2.imwrite(str(picture), np.full((40, 60), 254, np.uint8))
    with pytest.raises(DriveError, match=r"name its map\.yaml") as refused:
        FloorPlan.open(picture)
    lines = re.findall(r"(image: \S+(?=,)|resolution: [0-9.]+|origin: \[.*?\])", str(refused.value))
    (tmp_path / "map.yaml").write_text("\n".join(lines), encoding="utf-8")
    assert FloorPlan.open(tmp_path / "map.yaml").size_m == (3.0, 2.0)


def test_a_missing_file_and_a_link_to_outside_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match="cannot be read"):
        FloorPlan.open(tmp_path / "map.yaml")
    folder = tmp_path / "unpacked"
    folder.mkdir()
    write_plan(tmp_path)
    path = write_plan(folder)
    (folder / "map.pgm").unlink()
    try:
        os.symlink(tmp_path / "map.pgm", folder / "map.pgm")
    except OSError:
        pytest.skip("links need rights here")
    with pytest.raises(DriveError, match="lies outside"):
        FloorPlan.open(path)


def test_a_large_plan_is_drawn_smaller_and_unknown_floor_is_clear(tmp_path: Path) -> None:
    plan = FloorPlan.open(write_plan(tmp_path))

    assert plan.picture(100).shape == (4, 6, 4)
    assert plan.picture(3).shape == (2, 3, 4)
    assert plan.picture(100)[0, :, 3].tolist() == [255] * 5 + [0]
    assert plan.picture(100)[0, 0, 0] > plan.picture(100)[1, 1, 0]


@pytest.mark.parametrize("pairs", [2, 3, 5])
def test_points_tell_how_a_plan_lies(pairs: int) -> None:
    frame = np.array([3.0, -7.0, 2.5])
    points = np.random.default_rng(pairs).uniform(-9, 9, (pairs, 3)).round(3)
    poses = {10 * k: compose(frame, point) for k, point in enumerate(points)}

    found = align_floor_plan([f"{10 * k}={x},{y}" for k, (x, y, _) in enumerate(points)], poses)

    np.testing.assert_allclose(found.pose, frame, atol=1e-9)
    assert found.error_m == pytest.approx(0, abs=1e-9)


def test_points_that_do_not_fit_are_told_and_no_points_keep_the_frame() -> None:
    poses = {1: np.array([0.0, 0, 0]), 2: np.array([4.0, 0, 0])}

    found = align_floor_plan(["1=0,0", "2=6,0"], poses)

    np.testing.assert_allclose(found.pose, (-1, 0, 0), atol=1e-12)
    assert found.error_m == pytest.approx(1.0)
    np.testing.assert_array_equal(align_floor_plan([], poses).pose, np.zeros(3))


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        (["1=0,0"], "at least 2 pairs"),
        (["1=0,0", "2=0.1,0"], "0.5 m apart"),
        (["1=0,0", "1=3,0"], "0.5 m apart"),
        (["1=0,0", "9=3,0"], "no node 9"),
        (["0,0", "2=3,0"], "NODE=X,Y"),
        (["1=0", "2=3,0"], "NODE=X,Y"),
        (["1=nan,0", "2=3,0"], "NODE=X,Y"),
        (["1=1e300,0", "2=3,0"], "NODE=X,Y"),
        (["here=0,0", "2=3,0"], "NODE=X,Y"),
    ],
)
def test_pairs_that_say_nothing_are_refused(pairs: list[str], expected: str) -> None:
    poses = {1: np.array([0.0, 0, 0]), 2: np.array([4.0, 0, 0])}
    with pytest.raises(OptionError, match=expected):
        align_floor_plan(pairs, poses)
