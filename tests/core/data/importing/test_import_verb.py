"""`ltvn import` makes a recording of a drive with one command, and says in one line what it cannot read."""

import json
from pathlib import Path

import pytest

from ltvn_core.cli import main
from ltvn_core.data.recording.reader import Recording
from tests.core.data.importing.drives import EXCERPT


def test_a_real_drive_is_imported_with_one_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tour = tmp_path / "tour.rrd"
    assert main(["import", str(EXCERPT), "--output", str(tour), "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["format"] == "tum"
    assert said["frames"] + sum(said["dropped"].values()) == 12
    assert said["rates_hz"]["rgb"] == pytest.approx(7.4, abs=0.2)
    assert said["camera"]["width"] == 320
    assert said["pieces_expected"] == 1
    assert said["odometry"] == "truth"
    assert any("looks down" in doubt for doubt in said["doubts"])
    assert f"ltvn build {tour} " in said["next_step"]
    recording = Recording.open(tour)
    assert recording.meta.scene == "real:tum_excerpt"
    assert recording.poses.exact is not None
    assert all(recording.observation(frame).tilt is not None for frame in recording.frames)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{tmp}/missing"], "There is no file or folder"),
        (["{tmp}/strange.bin"], "not in a supported format"),
        (["{tmp}/nothing.mp4"], "nothing.mp4 is empty"),
        (["{tmp}/bare"], "bare is an empty folder"),
        (["{tmp}/house.glb"], "--scene"),
        (["{tmp}/strange.bin", "--format", "floppy"], "No reader is called 'floppy'"),
        ([str(EXCERPT), "--camera", "1,2,3"], "--camera 1,2,3"),
        ([str(EXCERPT), "--every-m", "-1"], "--every-m"),
        ([str(EXCERPT), "--odometry-from", "source"], "has no odometry; found depth, rgb, truth"),
    ],
)
def test_what_cannot_be_imported_ends_with_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    (tmp_path / "strange.bin").write_bytes(b"\0\1\2\3" * 100)
    (tmp_path / "house.glb").write_bytes(b"glTF")
    (tmp_path / "nothing.mp4").touch()
    (tmp_path / "bare").mkdir()
    filled = [argument.replace("{tmp}", str(tmp_path)) for argument in arguments]
    assert main(["import", *filled, "--output", str(tmp_path / "tour.rrd")]) == 1
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
    assert not (tmp_path / "tour.rrd").exists()
