"""Imports a drive: raw frames are checked, selected, prepared and written as a recording, with a summary.

Owns the order of these steps, the count of left-out images, and the selection. A map needs images that differ, so an
image is kept when the robot has moved far enough, according to its odometry or, without odometry, to the images.
Independent of the format.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.atomic_files import atomic_output
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.drive_statistics import (
    NO_ODOMETRY,
    NO_TRUTH,
    STAMP_NOT_AFTER,
    TOO_LITTLE_MOTION,
    DriveStatistics,
)
from ltvn_core.data.importing.frame_preparation import FramePreparation
from ltvn_core.data.importing.import_options import (
    FramesWithOdometry,
    ImportOptions,
    OdometrySource,
    chosen_odometry,
    has_odometry,
)
from ltvn_core.data.importing.import_summary import ImportSummary, import_summary, unread_text
from ltvn_core.data.importing.odometry_comparison import OdometryComparison
from ltvn_core.data.importing.pose_outages import PoseOutages
from ltvn_core.data.importing.raw_frame import DriveReader, FrameMoment, RawFrame, SelectiveReader
from ltvn_core.data.recording.metadata import SOURCE_SCENE
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import DriveError, ImageError
from ltvn_core.findings import Finding, findings_of
from ltvn_core.geometry import wrap_angle
from ltvn_core.navigation.events import Note, StampedEvent
from ltvn_core.robots.robot_check import ObservationCheck
from ltvn_core.types import Observation, Pose, Rgb, Tilt

MOVED_SHARE = 0.04
"""Median shift of the tracked points above which an image is kept, as a share of the image's width."""
LOST_SHARE = 0.5
"""Share of the tracked points that must be lost for an image to be kept."""
_WIDTH_PX = 160
_POINTS = 120
_FEWEST_POINTS = 8
_ROUNDING = 1e-4
"""Tolerance for rounded poses of a source, in metres and radians, so that images 0.1 m apart are kept at a spacing of
0.1 m."""
_NOISE = 2.0
"""Mean difference of two images, in grey levels of 255, below which they count as equal."""
_DECIDING_FRAMES = 100
"""Number of kept images from whose median the camera's usual tilt is computed; they are written only after that."""
Progress = Callable[[int, int | None], None]
"""Callback with the number of images processed, and the number of all images if it is known."""


class FrameSelection(Protocol):
    """Decides for each image in turn whether to keep it, and updates its state if so."""

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether an image with this pose and tilt could be kept; called before the image is decoded."""
        ...

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the camera has moved enough since the last kept image."""
        ...


class MotionSelection:
    """Keeps an image after a minimum distance, or a minimum change of heading, pitch or roll."""

    def __init__(self, every_m: float, every_rad: float) -> None:
        """Take the spacing; every image is kept if both limits are 0."""
        self._every_m = every_m
        self._every_rad = every_rad
        self._last: NDArray[np.float64] | None = None

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the robot drove or turned enough; see `FrameSelection`."""
        if self._last is None:
            return True
        gap = _pose_and_tilt(pose, tilt) - self._last
        moved_m = np.hypot(*gap[:2])
        turned_rad = np.abs(wrap_angle(gap[2:])).max()
        # A pose with NaN is kept here; the later check of the frame rejects it and gives the reason.
        return not (moved_m < self._every_m - _ROUNDING and turned_rad < self._every_rad - _ROUNDING)

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the robot drove or turned enough; see `FrameSelection`."""
        if not self.may_keep(pose, tilt):
            return False
        self._last = _pose_and_tilt(pose, tilt)
        return True


class PictureSelection:
    """Keeps an image when its content has changed enough; for drives without any odometry."""

    def __init__(self) -> None:
        """Start before the first image."""
        self._last: NDArray[np.uint8] | None = None

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Accept every image, because only the decoded image shows whether it differs."""
        return True

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the image differs enough; see `FrameSelection`."""
        height = max(round(_WIDTH_PX * rgb.shape[0] / rgb.shape[1]), 1)
        small = cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        grey = np.asarray(small, np.uint8)
        if self._last is not None and self._last.shape == grey.shape and not _has_moved(self._last, grey):
            return False
        self._last = grey
        return True


def _pose_and_tilt(pose: Pose, tilt: Tilt | None) -> NDArray[np.float64]:
    return np.array([*pose, *(tilt or (0.0, 0.0))])


def _has_moved(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> bool:
    if float(cv2.absdiff(before, now).mean()) < _NOISE:
        return False
    points = cv2.goodFeaturesToTrack(before, _POINTS, 0.01, 5)
    if points is None or len(points) < _FEWEST_POINTS:
        return True
    found, status, _ = cv2.calcOpticalFlowPyrLK(before, now, points, None)  # type: ignore[call-overload]
    followed = status.ravel() == 1
    if followed.mean() < 1 - LOST_SHARE:
        return True
    moved_px = np.linalg.norm((found - points)[followed].reshape(-1, 2), axis=1)
    return float(np.median(moved_px)) >= MOVED_SHARE * _WIDTH_PX


def import_drive(
    reader: DriveReader,
    output: Path | str,
    options: ImportOptions = ImportOptions(),  # noqa: B008
    progress: Progress = lambda _done, _total: None,
) -> ImportSummary:
    """Write a drive to a new recording, which appears only when it is complete.

    Raises DriveError where nothing of the drive can be used, RecordingError where `output` exists or cannot be written.
    """
    output = Path(output)
    with atomic_output(output) as part:
        return _DriveImport(reader, options, progress).write(part, output)


class _DriveImport:
    """One import, from the first raw frame to the summary."""

    def __init__(self, reader: DriveReader, options: ImportOptions, progress: Progress) -> None:
        self._reader = reader
        self._options = options
        self._progress = progress
        self._choose(OdometrySource.AUTO)  # Until the first frames are seen.
        self._preparation: FramePreparation | None = None
        self._statistics: DriveStatistics | None = None
        self._dropped: Counter[str] = Counter()
        self._faults: list[str] = []
        self._check = ObservationCheck()
        self._comparison = OdometryComparison()
        self._sequence_findings: list[Finding] = []
        self._stamps: list[float] = []
        self._scene = options.scene or f"{SOURCE_SCENE}{reader.facts.place or reader.facts.format}"

    def write(self, path: Path, name: Path) -> ImportSummary:
        """Write the whole drive to `path`, and return the summary, in which the file has the name `name`."""
        observations = self._observations()
        first = list(islice(observations, _DECIDING_FRAMES))
        if not first or self._preparation is None or self._statistics is None:
            raise DriveError(self._nothing_left())
        camera = self._mounted_camera(self._preparation.camera, self._statistics.usual_pitch_rad)
        last_step = 0
        last_stamp = 0.0
        with RecordingWriter(
            path, scene=self._scene, config=self._config(self._preparation), fingerprint="", camera=camera
        ) as writer:
            for seen in chain(first, observations):
                writer.write_frame(seen)
                self._sequence_findings += self._check.findings(seen)
                last_step = seen.step
                last_stamp = seen.stamp
            summary = self._summary(name, self._statistics, camera)
            for finding in summary.findings:
                writer.write_event(StampedEvent(last_step, last_stamp, Note(str(finding), finding.severity)))
        return summary

    def _observations(self) -> Iterator[Observation]:
        """Yield the kept images, and count all others."""
        for raw in self._wanted_frames():
            try:
                observation = self._observation(raw)
            except ImageError as error:
                self._faults.append(str(error))
                self._dropped["image, depth or pose that cannot be"] += 1
                continue
            if observation is not None:
                yield observation

    def _wanted_frames(self) -> Iterator[RawFrame]:
        """Yield the frames that may be kept; a `SelectiveReader` decodes only those."""
        reader = self._reader
        if isinstance(reader, SelectiveReader) and has_odometry(reader, self._options.odometry):
            return reader.frames_where(self._is_wanted_of_selective)
        odometry, frames = FramesWithOdometry.of(reader, self._options.odometry)
        self._choose(odometry)
        return (raw for raw in frames if self._is_wanted(FrameMoment.of(raw)))

    def _is_wanted_of_selective(self, moment: FrameMoment) -> bool:
        if not self._stamps:
            self._choose(chosen_odometry(self._reader, [moment], self._options.odometry))
        return self._is_wanted(moment)

    def _choose(self, odometry: OdometrySource) -> None:
        self._odometry = odometry
        self._selection = _selection(self._options, odometry)
        self._outages = PoseOutages("the true pose" if odometry is OdometrySource.TRUTH else "odometry")

    def _is_wanted(self, moment: FrameMoment) -> bool:
        """Tell whether the image of a moment may be kept; if not, count the reason."""
        self._progress(len(self._stamps) + sum(self._reader.dropped.values()) + 1, self._reader.facts.frames)
        reason = self._reason_to_drop(moment)
        if reason is not None:
            self._dropped[reason] += 1
        return reason is None

    def _observation(self, raw: RawFrame) -> Observation | None:
        """Return the observation of a frame that may be kept; if it is left out, count the reason and return None."""
        pose = self._odometry.pose(FrameMoment.of(raw))
        assert pose is not None  # `_is_wanted` has checked this.
        is_compared = self._odometry is not OdometrySource.NONE
        is_kept = self._selection.keeps(raw.rgb, pose, raw.tilt)
        if not is_kept and not is_compared:
            self._dropped[TOO_LITTLE_MOTION] += 1
            return None
        if self._preparation is None or self._statistics is None:
            unread, _ = unread_text(self._reader.facts, "camera_info", "")
            self._preparation = FramePreparation(raw, fov_deg=self._options.fov_deg, unread=unread)
            self._statistics = DriveStatistics(
                facts=self._reader.facts,
                odometry=self._odometry,
                is_lens_known=self._preparation.is_lens_known,
                is_depth_registered=self._preparation.is_depth_registered,
                stamps=self._stamps,
                width_px=self._preparation.camera.width,
                field_of_view_rad=self._preparation.camera.horizontal_fov_rad,
            )
        observation = self._preparation.observation(raw, step=self._statistics.frames, odometry=pose)
        if is_compared:
            self._comparison.add(observation, self._preparation.camera)
        if not is_kept:  # The image was needed for the comparison alone.
            self._dropped[TOO_LITTLE_MOTION] += 1
            return None
        self._statistics.observe(observation, raw)
        return observation

    def _reason_to_drop(self, moment: FrameMoment) -> str | None:
        before = self._stamps[-1] if self._stamps else -np.inf
        self._stamps.append(max(moment.stamp, before))
        if not moment.stamp > before:
            return STAMP_NOT_AFTER
        pose = self._odometry.pose(moment)
        self._outages.add_image(moment.stamp, has_pose=pose is not None)
        if pose is None:
            return NO_TRUTH if self._odometry is OdometrySource.TRUTH else NO_ODOMETRY
        is_needed = self._comparison.needs(moment.stamp, pose) or self._selection.may_keep(pose, moment.tilt)
        return None if is_needed else TOO_LITTLE_MOTION

    def _mounted_camera(self, camera: CameraModel, usual_pitch_rad: float | None) -> CameraModel:
        """Return the camera with its mounting: height and pitch from the user's options, else the median pitch of the
        images."""
        height_m = self._options.height_m
        pitch_deg = self._options.pitch_deg
        usual = camera.pitch_rad if usual_pitch_rad is None else usual_pitch_rad
        return replace(
            camera,
            height_m=camera.height_m if height_m is None else height_m,
            pitch_rad=usual if pitch_deg is None else float(np.radians(pitch_deg)),
        )

    def _config(self, preparation: FramePreparation) -> Mapping[str, Any]:
        asked = {name: value for name, value in asdict(self._options).items() if value is not None}
        found = {**asked, "odometry": str(self._odometry), "is_lens_known": preparation.is_lens_known}
        if self._odometry is OdometrySource.SOURCE and self._reader.facts.odometry_frame:
            found["odometry_frame"] = self._reader.facts.odometry_frame
        return {"verb": "import", "format": self._reader.facts.format, "import": found}

    def _all_dropped(self) -> dict[str, int]:
        return dict(Counter(self._reader.dropped) + self._dropped)

    def _summary(self, name: Path, found: DriveStatistics, camera: CameraModel) -> ImportSummary:
        found.dropped = self._all_dropped()
        found.is_spacing_ignored = isinstance(self._selection, PictureSelection) and self._options.has_own_spacing
        faults = [f"An image was left out: {fault}" for fault in self._faults[:1]]
        if self._odometry is OdometrySource.NONE is not self._options.odometry and found.has_odometry:
            faults.append("Odometry was not used, because the first images have none; cut the drive where it begins.")
        told = findings_of([*self._reader.doubts, *self._outages.sentences(), *faults])
        return import_summary(
            found,
            recording=name,
            scene=self._scene,
            camera=camera,
            told=(*told, *self._sequence_findings, *self._comparison.findings()),
        )

    def _nothing_left(self) -> str:
        streams = ", ".join(f"{each.role or 'unused'} {each.name}" for each in self._reader.facts.streams) or "nothing"
        reasons = ", ".join(f"{reason}: {count}" for reason, count in self._all_dropped().items())
        if not reasons:
            return f"The drive holds no images at all; what was found: {streams}."
        faults = "".join(f" {fault}" for fault in [*self._faults[:1], *self._reader.doubts])
        return f"None of the images can be used ({reasons}).{faults} What was found: {streams}."


def _selection(options: ImportOptions, odometry: OdometrySource) -> FrameSelection:
    if odometry is OdometrySource.NONE and (options.every_m or options.every_deg):
        return PictureSelection()
    return MotionSelection(options.every_m, float(np.radians(options.every_deg)))
