"""The examples run as they stand, from any folder, and stay short enough to read at one go."""

import re
import runpy
import sys
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path

import cv2
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import ltvn_core as ltvn
from tests.core.simulation.two_room_mesh import box_house, save

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOK = EXAMPLES / "07_analyse_in_a_notebook.ipynb"
LONGEST = 60


def run(name: str, *arguments: str | Path, cwd: Path) -> str:
    """Run an example in this process, which has imported all that takes long, and return what it printed."""
    argv = [name, *map(str, arguments)]
    with chdir(cwd), redirect_stdout(StringIO()) as printed, pytest.MonkeyPatch.context() as changed:
        changed.setattr(sys, "argv", argv)
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    return printed.getvalue()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_an_example_is_short_and_begins_with_what_it_shows(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= LONGEST
    assert lines[0].startswith('"""')


def test_images_of_ones_own_become_a_map(tmp_path: Path) -> None:
    said = run("01_map_from_your_images.py", tmp_path, cwd=tmp_path)
    assert "60 images became" in said
    assert (tmp_path / "map.rrd").exists()


def test_a_recording_answers_what_failed(tmp_path: Path) -> None:
    said = run("02_replay_and_query.py", cwd=tmp_path)
    assert "query 3 failed (no path, not recognised)" in said
    assert "p 0.95" in said


def test_a_navigation_system_of_ones_own_reaches_goals(tmp_path: Path) -> None:
    said = run("03_write_a_navigation_system.py", save(box_house(), tmp_path / "house.glb"), cwd=tmp_path)
    assert said.count("arrived") >= 2


def test_a_rival_of_ones_own_reaches_goals(tmp_path: Path) -> None:
    said = run("18_write_a_rival.py", save(box_house(), tmp_path / "house.glb"), cwd=tmp_path)
    assert said.count("arrived") == 2


def test_a_predictor_of_ones_own_builds_a_map(tmp_path: Path) -> None:
    said = run("04_write_a_predictor.py", cwd=tmp_path)
    assert "200 images became" in said


@pytest.mark.slow
def test_two_systems_are_evaluated_and_plotted(tmp_path: Path) -> None:
    house = save(box_house(), tmp_path / "house.glb")
    said = run("06_evaluate_and_plot.py", tmp_path, "2", house, cwd=tmp_path)
    assert said.count("of 2 episodes") == 2
    assert (tmp_path / "success.png").stat().st_size > 5_000


def test_questions_are_answered_from_python(tmp_path: Path) -> None:
    said = run("09_ask_why_from_python.py", cwd=tmp_path)
    assert said.count(" failed (") >= 4
    assert "query 2 failed (wrong arrival, false edge)" in said
    assert "The first map has a gap" in said
    assert "It was removed at 9.6 s." in said
    assert "at step 3383: It was pruned after attempt 7" in said


def test_p_of_an_edge_is_read_with_rerun_and_plotted(tmp_path: Path) -> None:
    said = run("10_plot_p_of_an_edge.py", tmp_path / "p.png", cwd=tmp_path)
    recording = ltvn.Recording.open(EXAMPLES.parent / "recordings" / "demo-fault.rrd")
    story = ltvn.analysis.edge_story(ltvn.Timeline.of(recording.events), 1489, 2621)
    believed = [f"{instant.stamp:.1f} s  p = {edge.belief.p:.3f}" for instant, edge in story.beliefs]
    assert [line.strip() for line in said.splitlines()[:-1]] == [*believed, "338.1 s  p = 0.000"]
    assert (tmp_path / "p.png").stat().st_size > 5_000


def test_two_maps_are_compared(tmp_path: Path) -> None:
    said = run("11_compare_two_maps.py", cwd=tmp_path)
    assert "327 nodes are in both, matched by id" in said
    assert "4 edges are only in demo-map.rrd: 1158 -> 2465" in said
    assert "3 edges are only in demo-fault.rrd: 2621 -> 1489" in said
    assert "1493 -> 1489: p 0.95, length 0.58 became p 0.95, length 0.73; attempts 0 to 3" in said


def test_maps_of_two_drives_are_compared_by_their_poses(tmp_path: Path) -> None:
    recordings = EXAMPLES.parent / "recordings"
    said = run("11_compare_two_maps.py", recordings / "demo-drive.rrd", recordings / "demo-map.rrd", cwd=tmp_path)
    assert "matched by pose" in said


def test_a_plan_turns_when_the_map_or_a_threshold_is_another(tmp_path: Path) -> None:
    said = run("12_plan_under_another_threshold.py", cwd=tmp_path)
    assert "belief_weight 1.5: cost 4.88, 2 nodes: 1489 -> 2621" in said
    assert "without the edge: cost 15.49, 21 nodes" in said
    assert "belief_weight 0: cost 2.48, 2 nodes" in said
    assert "belief_weight 20: cost 33.58, 20 nodes" in said


@pytest.mark.slow
def test_a_planar_robot_arrives_at_its_goal(tmp_path: Path) -> None:
    said = run("13_drive_a_planar_robot.py", cwd=tmp_path)
    assert "query 0 ended: arrived" in said
    away = re.search(r"The small robot stands (\S+) m from where", said)
    assert away is not None
    assert float(away[1]) < 0.5


def test_rows_of_ones_own_stand_in_the_recording(tmp_path: Path) -> None:
    said = run("14_write_your_own_rows_into_a_recording.py", tmp_path / "own.rrd", cwd=tmp_path)
    assert "/my/contrast: 30 rows" in said
    assert "/my/edges: 30 rows" in said
    assert "/my/remarks: 2 rows" in said
    assert "whole, 30 images" in said
    assert len(ltvn.Recording.open(tmp_path / "own.rrd").frames) == 30


def test_a_policy_from_an_onnx_file_builds_a_map(tmp_path: Path) -> None:
    said = run("15_run_an_onnx_policy.py", tmp_path / "policy", cwd=tmp_path)
    assert "80 images became" in said
    assert ltvn.Recording.open(tmp_path / "policy" / "map.rrd").meta.config["predictor"] == "onnx"


def test_a_picture_is_found_in_a_map_of_another_drive(tmp_path: Path) -> None:
    said = run("16_find_a_picture_in_a_map.py", cwd=tmp_path)
    found = [float(likeness) for likeness in re.findall(r"r (\S+), ", said)]
    assert len(found) == 3
    assert found[0] > 0.8


def test_the_notebook_runs_from_top_to_bottom() -> None:
    notebook = nbformat.read(NOTEBOOK, nbformat.NO_CONVERT)
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(EXAMPLES)}}).execute()
    figures = [output for cell in notebook.cells for output in cell.get("outputs", []) if "image/png" in str(output)]
    assert len(figures) == 2


IMPORTS = re.compile(r"^(?:from (ltvn_\w+(?:\.\w+)*) import|import (ltvn_\w+))", re.MULTILINE)


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("*.py")), ids=lambda path: path.stem)
def test_an_example_imports_one_module_of_a_border_at_most(path: Path) -> None:
    modules = {first or second for first, second in IMPORTS.findall(path.read_text(encoding="utf-8"))}
    borders = [".".join(name.split(".")[:2]) for name in modules - {"ltvn_core", "ltvn_core.palette"}]

    assert len(borders) == len(set(borders))


def test_a_format_of_ones_own_is_imported(tmp_path: Path) -> None:
    source = tmp_path / "00"
    (source / "image_2").mkdir(parents=True)
    rng = np.random.default_rng(0)
    for k in range(5):
        cv2.imwrite(str(source / f"image_2/{k:06d}.png"), rng.integers(0, 255, (48, 64, 3), np.uint8))
    (source / "times.txt").write_text("".join(f"{k / 10:e}\n" for k in range(5)), encoding="utf-8")
    poses = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {k / 2}\n" for k in range(5))  # The camera's z points forward.
    (source / "poses.txt").write_text(poses, encoding="utf-8")
    (source / "calib.txt").write_text("P0: 1 2\nP2: 60 0 31.5 0 0 60 23.5 0 0 0 1 0\n", encoding="utf-8")

    said = run("17_import_your_own_format.py", source, tmp_path / "kitti.rrd", cwd=tmp_path)
    assert "5 images along 2.0 m" in said
    drive = ltvn.Recording.open(tmp_path / "kitti.rrd")
    assert drive.meta.camera is not None
    assert drive.meta.camera.fx == 60
    assert (
        drive.observation(drive.frames[-1]).odometry[:2] - drive.observation(drive.frames[0]).odometry[:2]
    ).max() == 2


ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
CODE = "\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
ROWS = re.findall(r"^\|.*\.py` \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("name", sorted(set(ltvn.__all__) - {"__version__"}))
def test_each_public_name_has_an_example(name: str) -> None:
    if f"ltvn.{name}" in CODE:
        return
    rows = [row for row in ROWS if f"`{name}`" in row]
    assert rows, "neither in the table nor in the code of docs/reference.md"
    for row in rows:
        examples = [ROOT / "examples" / path for path in re.findall(r"`(\d\d_\w+\.py)`", row)]
        assert any(f"ltvn.{name}" in path.read_text(encoding="utf-8") for path in examples)
