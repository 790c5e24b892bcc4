"""What cannot be right of a drive is told once, and nothing is told of a drive that is in order."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.recorded_run import RecordedRobot, record_images
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.navigation.events import Note, Severity
from ltvn_core.robots.robot_check import ObservationCheck, sequence_findings
from ltvn_core.robots.robot_report import fit_floor
from ltvn_core.types import Observation
from tests.core.data.recording import example_recording
from tests.core.flat_world import FlatRobot, one_room
from tests.repository import DEMO_DRIVE, DEMO_MAP


def drive(images: int = 40) -> list[Observation]:
    """A straight drive of 0.1 m a step whose images all differ."""
    straight = [np.array([0.1 * k, 0.0, 0.0]) for k in range(images)]
    return [
        replace(example_recording.observation(k), odometry=pose, stamp=0.1 * k, step=k)
        for k, pose in enumerate(straight)
    ]


Change = Callable[[list[Observation]], list[Observation]]


def at(place: int, **fields: object) -> Change:
    return lambda images: [replace(seen, **fields) if k == place else seen for k, seen in enumerate(images)]  # type: ignore[arg-type]


WRONG: dict[str, tuple[Change, str]] = {
    "repeated step": (at(7, step=6), "Step 6 appeared twice"),
    "backward step": (at(7, step=2), "Step 2 follows step 6"),
    "backward stamp": (at(7, stamp=0.2), "back from 0.600 s to 0.200 s"),
    "standing clock": (lambda images: [replace(seen, stamp=1.0) for seen in images], "clock stopped"),
    "jump": (at(7, odometry=np.array([100.0, 0.0, 0.0])), "jumps by 99 m"),
    "alike": (
        lambda images: [replace(seen, rgb=images[0].rgb) for seen in images],
        "are equal, although the robot drove",
    ),
    "covered": (lambda images: [replace(seen, rgb=np.zeros_like(seen.rgb)) for seen in images], "is it covered?"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_cannot_be_right_is_told_once(what: str) -> None:
    change, said = WRONG[what]
    told = sequence_findings(change(drive()))
    assert len([finding for finding in told if said in str(finding)]) == 1


def test_a_drive_in_order_is_not_doubted() -> None:
    assert sequence_findings(drive()) == ()
    standing = [replace(seen, odometry=np.zeros(3), rgb=drive()[0].rgb) for seen in drive()]
    assert sequence_findings(standing) == ()
    assert sequence_findings([seen for seen in drive() for _ in range(3)]) == ()


@pytest.mark.parametrize("path", [DEMO_DRIVE, DEMO_MAP], ids=lambda path: path.stem)
def test_our_own_recordings_are_not_doubted(path: Path) -> None:
    recording = Recording.open(path)
    assert sequence_findings(recording.observation(frame) for frame in recording.frames) == ()


def test_a_doubt_is_a_note_in_the_recording(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "drive.rrd", scene="", config={}, fingerprint="") as writer:
        for _ in record_images(WRONG["jump"][0](drive()), writer):
            pass
    notes = [stamped.event for stamped in Recording.open(tmp_path / "drive.rrd").events]
    assert [(type(note), note.severity) for note in notes if isinstance(note, Note)] == [(Note, Severity.WARN)]


def test_a_robot_whose_camera_stands_still_is_noted(tmp_path: Path) -> None:
    robot = FlatRobot(one_room(), (0.5, 2.0, 0.0))  # Its images are all black.
    with RecordingWriter(tmp_path / "drive.rrd", scene="", config={}, fingerprint="") as writer:
        recorded = RecordedRobot(robot, writer)
        for _ in range(40):
            recorded.observe()
            robot.pose[0] += 0.05
            robot._odometry[0] += 0.05
            robot.step += 1
    (note,) = (stamped.event for stamped in Recording.open(tmp_path / "drive.rrd").events)
    assert isinstance(note, Note)
    assert "is it covered?" in note.text


def test_each_rule_speaks_again_for_another_robot() -> None:
    for _ in range(2):
        check = ObservationCheck()
        assert any([check.findings(seen) for seen in WRONG["jump"][0](drive())])


SAID = CameraModel.from_fov(96, 72, math.radians(70), height_m=0.6, pitch_rad=-0.2)


def floor_depth(camera: CameraModel) -> np.ndarray:
    """The depth (72, 96) of an endless floor."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = camera.unproject(np.stack([columns, rows], axis=-1), np.ones(rows.shape)) - [0, 0, camera.height_m]
    with np.errstate(divide="ignore"):
        return np.where(rays[..., 2] < -1e-6, -camera.height_m / rays[..., 2], 0).astype(np.float32)


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg", "height_m"), [(0, 0, 0), (4, 0, 0), (-3, 0, 0), (0, 3, 0), (2, -2, 0.05)]
)
def test_the_floor_tells_what_is_off(pitch_deg: float, roll_deg: float, height_m: float) -> None:
    true = replace(
        SAID,
        pitch_rad=SAID.pitch_rad + math.radians(pitch_deg),
        roll_rad=math.radians(roll_deg),
        height_m=SAID.height_m + height_m,
    )

    off = fit_floor(floor_depth(true), SAID)

    assert off is not None
    assert (off.pitch_off_deg, off.roll_off_deg) == pytest.approx((pitch_deg, roll_deg), abs=0.3)
    assert off.height_off_m == pytest.approx(height_m, abs=0.02)


def test_no_floor_tells_nothing() -> None:
    assert fit_floor(np.zeros((72, 96), np.float32), SAID) is None
