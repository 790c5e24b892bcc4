"""Whatever format a drive comes from, its recording holds what the source's camera would have taken without faults."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.drive_statistics import coverage, drift
from ltvn_core.data.importing.frame_preparation import recorded_camera
from ltvn_core.data.importing.import_options import ImportOptions, OdometrySource
from ltvn_core.data.importing.raw_frame import FrameFilter, FrameMoment, RawFrame, ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import DriveError, OptionError, RecordingError
from ltvn_core.types import Tilt
from tests.core.data.importing.drives import FORWARD, ListedDrive, sight, write_tum_folder

PLAIN = CameraModel.from_fov(640, 480, np.radians(70), height_m=0.9)
SMALL = CameraModel.from_fov(160, 120, np.radians(60))
LENSES = {
    "plain": PLAIN,
    "wide screen": CameraModel.from_fov(1280, 720, np.radians(80)),
    "distorted": replace(PLAIN, distortion=(0.26, -0.95, -0.005, 0.003, 1.16)),
    "barrel": replace(PLAIN, distortion=(-0.3, 0.1, 0.001, 0.0)),
    "fisheye": replace(PLAIN, fx=250.0, fy=250.0, fisheye=True, distortion=(0.02, -0.01, 0.004, -0.001)),
    "on its side": replace(PLAIN, width=480, height=640, cx=230.0, cy=330.0, quarter_turns=1),
    "upside down": replace(PLAIN, cx=300.0, quarter_turns=2),
    "pitched and rolled": replace(PLAIN, pitch_rad=-0.3, roll_rad=0.12),
    "small": SMALL,
}


def frame(k: int = 0, *, x: float = 0.0, yaw: float = 0.0, camera: CameraModel | None = SMALL) -> RawFrame:
    pose = np.array([x, 0.0, yaw])
    return RawFrame(stamp=10 + k / 10, rgb=sight(camera or SMALL), camera=camera, odometry=pose, name=f"image {k}")


def at(poses: np.ndarray, *, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    return poses + np.array([0.0, y, yaw])


@pytest.fixture
def output(tmp_path: Path) -> Path:
    return tmp_path / "tour.rrd"


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES.keys())
def test_images_are_upright_and_small_and_keep_the_lens_that_took_them(output: Path, camera: CameraModel) -> None:
    raw = replace(frame(camera=camera), depth_m=np.full((camera.height, camera.width), 2.0, np.float32))
    import_drive(ListedDrive([raw], ("rgb", "depth", "odometry")), output)
    recording = Recording.open(output)
    recorded, seen = recording.meta.camera, recording.observation(0)
    assert (recorded.quarter_turns, recorded.roll_rad) == (0, 0)
    assert (recorded.fisheye, recorded.distortion) == (camera.fisheye, camera.distortion)
    assert max(recorded.width, recorded.height) <= 320
    assert recorded.pitch_rad == camera.pitch_rad
    assert recorded.height_m == camera.height_m
    shown = seen.rgb.max(axis=-1) > 25  # The corners of a rolled image are black.
    assert shown.mean() > 0.9
    assert np.abs(seen.rgb.astype(int) - sight(recorded))[shown].mean() < 3
    depth = seen.require_depth("the test")
    assert np.allclose(depth[depth > 0], 2.0, atol=0.002)
    assert (depth > 0).mean() > 0.9


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_distorted_lens_is_the_same_lens_in_the_picture_that_is_set_upright(turns: int) -> None:
    lens = replace(SMALL, fx=130.0, distortion=(-0.2, 0.05, 0.01, -0.02), quarter_turns=turns)
    right, down = lens.width - 1, lens.height - 1
    for x, y in ((20.0, 30.0), (120.0, 50.0), (80.0, 100.0)):
        turned = {1: (y, right - x), 2: (right - x, down - y), 3: (down - y, x)}[turns]
        assert np.allclose(recorded_camera(lens).project(lens.unproject([x, y], 2.0)), turned, atol=1e-6)


def test_an_image_with_a_tilt_of_its_own_is_kept_as_it_was_taken(output: Path) -> None:
    tilts = [Tilt(-0.5, 0.3), Tilt(-0.2, -0.3), Tilt(-0.4, 0.0)]
    taken = [replace(SMALL, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad) for tilt in tilts]
    drive = [replace(frame(k, x=k), rgb=sight(c), tilt=t) for k, (c, t) in enumerate(zip(taken, tilts, strict=True))]
    summary = import_drive(ListedDrive(drive, ("rgb", "odometry")), output)
    recording = Recording.open(output)
    assert recording.meta.camera.pitch_rad == -0.4
    assert summary.tilt is not None
    assert summary.tilt.pitch_lowest_deg == pytest.approx(np.degrees(-0.5))
    for k, tilt in enumerate(tilts):
        seen = recording.observation(k)
        assert seen.tilt == tilt
        as_taken = replace(recording.meta.camera, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad)
        assert np.abs(seen.rgb.astype(int) - sight(as_taken)).mean() < 3


def test_depth_of_another_lens_is_laid_over_the_colours_and_that_is_said(output: Path) -> None:
    lens = CameraModel.from_fov(320, 240, np.radians(100))
    columns = np.mgrid[:240, :320][1]
    depth = (1 + lens.pixels_to_rays(np.stack([columns, columns], -1))[..., 0] * 0.2).astype(np.float32)
    raw = replace(frame(camera=PLAIN), depth_m=depth, depth_camera=lens)
    summary = import_drive(ListedDrive([raw], ("rgb", "depth", "odometry")), output)
    recording = Recording.open(output)
    camera = recording.meta.camera
    rows, columns = np.mgrid[: camera.height, : camera.width]
    expected = 1 + camera.pixels_to_rays(np.stack([columns, rows], -1))[..., 0] * 0.2
    assert np.abs(recording.observation(0).require_depth("the test") - expected).max() < 0.01
    assert any("not registered" in doubt for doubt in summary.doubts)


def test_what_a_depth_camera_says_of_nothing_is_no_return(output: Path) -> None:
    depth = np.full((120, 160), np.nan, np.float32)
    depth[:, :80], depth[:50] = 3.0, -np.inf
    import_drive(ListedDrive([replace(frame(), depth_m=depth)], ("rgb", "odometry")), output)
    recorded = Recording.open(output).observation(0).require_depth("the test")
    assert not recorded[:50].any()
    assert not recorded[:, 80:].any()
    assert (recorded[50:, :80] == 3).all()


def test_images_are_thinned_by_metres_and_degrees_and_all_can_be_kept(tmp_path: Path) -> None:
    drive = [frame(k, x=0.03 * k) for k in range(20)] + [frame(20 + k, x=0.57, yaw=0.05 * k) for k in range(20)]
    thin = import_drive(ListedDrive(drive, ("rgb", "odometry")), tmp_path / "thin.rrd")
    every = import_drive(
        ListedDrive(drive, ("rgb", "odometry")), tmp_path / "all.rrd", ImportOptions(every_m=0, every_deg=0)
    )
    poses = Recording.open(tmp_path / "thin.rrd").poses.odometry
    steps = np.abs(np.diff(poses, axis=0))
    assert ((steps[:, 0] > 0.1) | (steps[:, 2] > np.radians(8))).all()
    assert 8 < thin.frames < 16
    assert thin.dropped == {"too little motion": 40 - thin.frames}
    assert every.frames == 40


def test_without_any_poses_images_are_thinned_by_what_they_show(output: Path) -> None:
    still = [replace(frame(k), odometry=None) for k in range(10)]
    turning = [replace(SMALL, pitch_rad=0.04 * k) for k in range(1, 11)]
    drive = [*still, *(replace(frame(10 + k), rgb=sight(c), odometry=None) for k, c in enumerate(turning))]
    summary = import_drive(ListedDrive(drive), output)
    assert 3 <= summary.frames <= 11
    assert summary.odometry is OdometrySource.NONE
    assert summary.pieces_expected is None
    assert any("no odometry" in doubt for doubt in summary.doubts)
    assert not Recording.open(output).poses.odometry.any()


def test_true_poses_stand_in_for_odometry_only_where_there_is_none_or_they_are_asked_for(tmp_path: Path) -> None:
    drive = [replace(frame(k, x=0.2 * k), truth=np.array([1.0, 0.2 * k, 0.0])) for k in range(5)]
    both = ListedDrive(drive, ("rgb", "odometry", "truth"))
    own = import_drive(both, tmp_path / "own.rrd")
    asked = import_drive(both, tmp_path / "asked.rrd", ImportOptions(odometry=OdometrySource.TRUTH))
    driven_blind = [replace(raw, odometry=None) for raw in drive]
    alone = import_drive(ListedDrive(driven_blind, ("rgb", "truth")), tmp_path / "alone.rrd")
    assert [each.odometry for each in (own, asked, alone)] == ["source", "truth", "truth"]
    for name, column in (("own", 0), ("asked", 1), ("alone", 1)):
        recording = Recording.open(tmp_path / f"{name}.rrd")
        assert recording.poses.odometry[:, column] == pytest.approx(np.arange(5) * 0.2)
        assert recording.poses.exact is not None
        told = recording.meta.config["import"]
        assert told["odometry"] == ("source" if name == "own" else "truth")
        assert told.get("odometry_frame") == ("odom" if name == "own" else None)


def test_what_is_wrong_with_an_image_is_counted_and_the_others_are_kept(output: Path) -> None:
    drive = [frame(k, x=0.3 * k) for k in range(8)]
    drive[2] = replace(drive[2], stamp=9.0)
    drive[3] = replace(drive[3], odometry=None)
    drive[4] = replace(drive[4], odometry=np.array([np.nan, 0, 0]))
    drive[5] = replace(drive[5], depth_m=np.full((120, 160), 2500, np.float32))
    drive[6] = replace(drive[6], rgb=sight(LENSES["wide screen"]))
    summary = import_drive(ListedDrive(drive, ("rgb", "odometry")), output)
    assert summary.frames == 3
    assert summary.dropped == {
        "stamp not after the one before": 1,
        "no odometry at that time": 1,
        "image, depth or pose that cannot be": 3,
    }
    assert any("5 images could not be used" in doubt for doubt in summary.doubts)
    assert verify(output).frames == 3


def test_depth_from_a_lens_that_nobody_knows_is_refused_with_what_to_give(output: Path) -> None:
    raw = replace(frame(camera=None), depth_m=np.ones((120, 160), np.float32))
    with pytest.raises(DriveError, match=r"--camera.*--fov"):
        import_drive(ListedDrive([raw], ("rgb", "odometry")), output)
    assert not output.exists()
    summary = import_drive(ListedDrive([raw], ("rgb", "odometry")), output, ImportOptions(fov_deg=70))
    assert summary.camera.horizontal_fov_deg == pytest.approx(70, abs=0.01)


def test_colours_alone_come_in_with_an_assumed_lens_and_a_loud_doubt(output: Path) -> None:
    summary = import_drive(ListedDrive([frame(camera=None)], ("rgb", "odometry")), output)
    assert not summary.camera.is_lens_known
    assert any("The lens is unknown" in doubt for doubt in summary.doubts)
    notes = [str(event.event) for event in Recording.open(output).events]
    assert any("The lens is unknown" in note for note in notes)


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (lambda: ListedDrive([]), "holds no images at all"),
        (lambda: ListedDrive([replace(frame(), odometry=None)], ("rgb", "odometry")), "no odometry at that time: 1"),
    ],
)
def test_a_drive_of_which_nothing_is_left_says_why_and_leaves_no_file(
    output: Path, drive: Callable[[], ListedDrive], message: str
) -> None:
    with pytest.raises(DriveError, match=message):
        import_drive(drive(), output)
    assert list(output.parent.iterdir()) == []


def test_a_recording_that_exists_is_never_replaced(output: Path) -> None:
    output.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="exists"):
        import_drive(ListedDrive([frame()], ("rgb", "odometry")), output)
    assert output.read_bytes() == b"precious"


@pytest.mark.parametrize(
    "options",
    [
        lambda: ImportOptions(every_m=-1),
        lambda: ImportOptions(every_deg=np.nan),
        lambda: ImportOptions(height_m=-1),
        lambda: ImportOptions(pitch_deg=91),
    ],
)
def test_numbers_that_cannot_be_are_refused(options: Callable[[], ImportOptions]) -> None:
    with pytest.raises(OptionError, match="--"):
        options()


def test_odometry_that_is_not_there_is_not_taken(output: Path) -> None:
    with pytest.raises(DriveError, match=r"has no truth; found odometry, rgb"):
        import_drive(ListedDrive([frame()], ("odometry", "rgb")), output, ImportOptions(odometry=OdometrySource.TRUTH))


def test_a_map_is_foretold_in_as_many_pieces_as_the_drive_has() -> None:
    line = np.array([[0.3 * k, 0.0, 0.0] for k in range(10)])
    stamps = np.arange(20.0)
    apart = coverage(np.concatenate([line, at(line, y=5)]), stamps)
    back = coverage(np.concatenate([line, at(line[::-1], y=0.1)]), stamps)
    turned = coverage(np.concatenate([line, at(line[::-1], yaw=np.pi)]), stamps)
    assert (apart.pieces, apart.largest_share, apart.revisited_share) == (2, 0.5, 0.0)
    assert (back.pieces, back.revisited_share > 0.15) == (1, True)
    assert turned.pieces == 2


def test_drift_is_measured_per_metre_wherever_odometry_began() -> None:
    truth = np.array([[0.1 * k, 0.0, 0.0] for k in range(50)])
    stretched = np.column_stack([np.full(50, 7.0), 3 + 1.1 * truth[:, 0], np.full(50, np.pi / 2)])
    found = drift(stretched, truth)
    assert found is not None
    assert found.per_metre == pytest.approx(0.1, abs=0.001)
    assert found.yaw_deg_per_metre == pytest.approx(0, abs=1e-6)
    assert drift(stretched[:5], truth[:5]) is None


def test_an_image_that_is_not_kept_is_not_even_decoded(tmp_path: Path) -> None:
    poses = [f"{100 + k / 10:.4f} {0.2 * (k // 2):.2f} 1 0.5 {FORWARD}" for k in range(4)]
    folder = write_tum_folder(tmp_path / "drive", pose_lines=poses)
    for unmoved in ("100.10", "100.30"):
        (folder / f"rgb/{unmoved}.png").write_bytes(b"not looked at")
    summary = import_drive(open_drive(folder, options=ReadOptions(camera=SMALL.scaled(64, 48))), tmp_path / "tour.rrd")
    assert dict(summary.dropped) == {"too little motion": 2}
    assert Recording.open(tmp_path / "tour.rrd").poses.stamps.tolist() == [100.0, 100.2]


def test_a_damaged_image_does_not_stand_for_the_next_one(tmp_path: Path) -> None:
    poses = [f"{100 + k / 10:.4f} {0.06 * k:.2f} 1 0.5 {FORWARD}" for k in range(4)]
    folder = write_tum_folder(tmp_path / "drive", pose_lines=poses)
    (folder / "rgb/100.20.png").write_bytes(b"damaged")
    summary = import_drive(open_drive(folder, options=ReadOptions(camera=SMALL.scaled(64, 48))), tmp_path / "tour.rrd")
    assert dict(summary.dropped) == {"too little motion": 1, "damaged or missing image": 1}
    assert Recording.open(tmp_path / "tour.rrd").poses.stamps.tolist() == [100.0, 100.3]


def test_odometry_that_only_the_frames_carry_is_used(output: Path) -> None:
    late = [replace(frame(k, x=0.2 * k), odometry=None if k == 0 else frame(k, x=0.2 * k).odometry) for k in range(6)]

    summary = import_drive(ListedDrive(late, ()), output)

    assert (summary.odometry, summary.frames) == (OdometrySource.SOURCE, 5)
    assert np.allclose(Recording.open(output).poses.odometry[:, 0], [0.2, 0.4, 0.6, 0.8, 1.0])
    assert not any("no odometry" in doubt for doubt in summary.doubts)


def test_true_poses_depth_and_tilt_that_only_the_frames_carry_are_used(output: Path) -> None:
    depth = np.full((SMALL.height, SMALL.width), 2.0, np.float32)
    carried = [
        replace(frame(k), odometry=None, truth=np.array([0.2 * k, 0, 0]), depth_m=depth, tilt=Tilt(-0.1, 0.0))
        for k in range(4)
    ]

    summary = import_drive(ListedDrive(carried, ()), output)

    recording = Recording.open(output)
    assert (summary.odometry, summary.frames, summary.without_depth) == (OdometrySource.TRUTH, 4, 0)
    assert summary.tilt is not None
    assert recording.poses.exact is not None
    assert np.allclose(recording.poses.exact[:, 0], [0, 0.2, 0.4, 0.6])


class SelectiveDrive(ListedDrive):
    """A reader that decodes only the images that are wanted."""

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        return (raw for raw in self.frames() if wanted(FrameMoment.of(raw)))


@pytest.mark.parametrize("wanted", [OdometrySource.AUTO, OdometrySource.SOURCE])
def test_a_reader_that_selects_needs_no_fact_about_its_odometry_either(output: Path, wanted: OdometrySource) -> None:
    drive = SelectiveDrive([frame(k, x=0.2 * k) for k in range(4)], ())

    summary = import_drive(drive, output, ImportOptions(odometry=wanted))

    assert (summary.odometry, summary.path_m) == (OdometrySource.SOURCE, pytest.approx(0.6))
