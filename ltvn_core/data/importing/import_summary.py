"""The summary of an import, for people and programs, and its findings about the drive.

Owns the limits above which something is doubtful, the likely cause, and the advice. Does not reject any drive.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.drive_statistics import (
    NO_ODOMETRY,
    NO_TRUTH,
    STAMP_NOT_AFTER,
    Drift,
    DriveStatistics,
    TiltRange,
    path_m,
)
from ltvn_core.data.importing.frame_preparation import ASSUMED_FOV_DEG
from ltvn_core.data.importing.import_options import OdometrySource
from ltvn_core.data.importing.raw_frame import NO_DEPTH, NO_POSE, NOT_LATER, DriveFacts
from ltvn_core.data.importing.revisits import NEAR_M
from ltvn_core.data.importing.source_camera import HOW_TO, HOW_TO_SCALE
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.geometry import wrap_angle

STEEP_DEG = 20.0
"""Pitch in degrees above which a level predictor sees less than two thirds of a picture."""
ROLLED_DEG = 60.0
"""Roll in degrees above which the images are probably not upright."""
NARROW_PX = 160
"""Width in pixels below which the geometric predictor, which compares real images, finds too few key points."""
NEAREST_MEDIAN_M = 0.1
FARTHEST_MEDIAN_M = 10.0
"""The median depth of a robot's camera plausibly lies between `NEAREST_MEDIAN_M` and this, in metres."""
Z_BUFFER_ABOVE = 0.9
"""Largest number of a z-buffer, whose numbers end at 1 and crowd there; a drive sees something beyond a metre."""
MUCH_DRIFT = 0.15
FEW_FRAMES = 20
MANY_GAPS = 3
_MOST_NAMES = 10
_KEEP_ALL = "--every-m 0 --every-deg 0 keeps every image."
_APART_SHARE = 0.1
_DROPPED_SHARE = 0.1
_NO_ROW = "Do its rows cover the whole drive, with stamps of the clock of the images?"
_CAUSES = {
    STAMP_NOT_AFTER: "Are the stamps written with too few digits, or all alike?",
    NO_ODOMETRY: f"Odometry is missing for some images. {_NO_ROW}",
    NO_TRUTH: f"True poses are missing for some images. {_NO_ROW}",
    NO_POSE: "",
    NO_DEPTH: "Depth is missing for some images; was it recorded at a lower rate, or were messages lost?",
    NOT_LATER: "Do the stamps of the images go back, or repeat?",
}
"""Likely causes of the reasons for which images are left out; empty where the reader tells the cause."""
_OTHER_CAUSE = "Is the file cut off, or do its streams have different clocks?"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedCamera:
    """The camera of the images of an imported recording."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    horizontal_fov_deg: float
    vertical_fov_deg: float
    height_m: float
    """Height above the floor in metres; 0 if it is unknown."""
    pitch_deg: float
    is_lens_known: bool
    """Whether the lens is known; False if the field of view was assumed."""

    @classmethod
    def of(cls, camera: CameraModel, *, is_lens_known: bool) -> "ImportedCamera":
        """Describe a camera."""
        return cls(
            width=camera.width,
            height=camera.height,
            fx=round(camera.fx, 3),
            fy=round(camera.fy, 3),
            cx=round(camera.cx, 3),
            cy=round(camera.cy, 3),
            horizontal_fov_deg=round(math.degrees(camera.horizontal_fov_rad), 2),
            vertical_fov_deg=round(math.degrees(camera.vertical_fov_rad), 2),
            height_m=round(camera.height_m, 3),
            pitch_deg=round(math.degrees(camera.pitch_rad), 2),
            is_lens_known=is_lens_known,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportSummary(WithDoubts):
    """Numbers of an import: found, left out and written."""

    recording: Path
    format: str
    """Name of the reader."""
    scene: str
    """Name of the place in the recording."""
    frames: int
    """Images of the recording."""
    dropped: Mapping[str, int]
    """Images that were left out, by reason."""
    without_depth: int
    """Images of the recording without any depth."""
    rates_hz: Mapping[str, float]
    """Rates of the source's streams, such as images and poses, per second."""
    camera: ImportedCamera
    odometry: OdometrySource
    """Source of the recorded odometry."""
    seconds: float
    """Duration from the first to the last image, on the source's clock."""
    path_m: float | None
    """Length of the path by odometry; None if there is none."""
    pieces_expected: int | None
    """Least number of pieces of a map: near images joined, and consecutive ones by odometry; None without poses."""
    largest_piece_expected: float | None
    """Share of the images in the largest expected piece."""
    revisited_share: float | None
    """Share of the images at a place where the drive had been before; such images can close loops."""
    gaps: int
    """Number of pauses between images that are much longer than usual."""
    longest_gap_s: float
    tilt: TiltRange | None
    """Tilt of the camera, if it changes."""
    drift: Drift | None
    """Deviation of odometry from the true poses, if the source has both."""
    findings: tuple[Finding, ...]
    """Doubts, with likely causes and advice; empty if there are none."""
    next_step: str
    """Recommended next step, and what it shows."""


def import_summary(
    found: DriveStatistics,
    *,
    recording: Path,
    facts: DriveFacts,
    scene: str,
    dropped: Mapping[str, int],
    camera: CameraModel,
    seconds: float,
    told: tuple[Finding, ...],
) -> ImportSummary:
    """Return the summary, from the statistics and the findings `told` of earlier steps."""
    rates = {stream.role: stream.rate_hz for stream in facts.streams if stream.role and stream.rate_hz}
    return ImportSummary(
        recording=recording,
        format=facts.format,
        scene=scene,
        frames=found.frames,
        dropped=dropped,
        without_depth=found.frames - found.with_depth,
        rates_hz={role: round(rate, 2) for role, rate in rates.items()},
        camera=ImportedCamera.of(camera, is_lens_known=found.is_lens_known),
        odometry=found.odometry,
        seconds=seconds,
        path_m=path_m(found.poses) if found.coverage else None,
        pieces_expected=found.coverage.pieces if found.coverage else None,
        largest_piece_expected=found.coverage.largest_share if found.coverage else None,
        revisited_share=found.coverage.revisited_share if found.coverage else None,
        gaps=len(found.gaps_s),
        longest_gap_s=max(found.gaps_s, default=0.0),
        tilt=found.tilt,
        drift=found.drift,
        findings=(*told, *_drive_findings(found)),
        next_step=(
            f"`ltvn build {recording} --output map.rrd` makes a map. Its `known_share` is the share of the drive that "
            "the map recognises; below 80 % it also lists where it fails, and likely causes."
        ),
    )


def _drive_findings(drive: DriveStatistics) -> Iterator[Finding]:
    """Yield what is doubtful about a drive, with the likely cause and advice."""
    for check in (_camera, _depth, _tilt, _odometry, _frames, _overlap, _dropped):
        yield from check(drive)


def unread_text(facts: DriveFacts, role: str, otherwise: str) -> tuple[str, str]:
    """Return what lies in the source and was not read, though it could have a role, and how to use it.

    Args:
        facts: The facts of the drive.
        role: The missing role, as in `SourceFact`.
        otherwise: The remedy where nothing lies there.

    Returns:
        The end of a sentence, empty where nothing lies there, and the remedy in whole sentences.
    """
    unread = facts.unread(role)
    if not unread:
        return "", otherwise
    by_option = f"Name the right one with --{role.replace('_', '-')}."
    names = ", ".join(stream.described for stream in unread[:_MOST_NAMES])
    return f"; not read: {names}", " ".join(dict.fromkeys(stream.remedy or by_option for stream in unread))


def _camera(drive: DriveStatistics) -> Iterator[Finding]:
    if not drive.is_lens_known:
        unread, remedy = unread_text(drive.facts, "camera_info", "")
        yield Finding(
            f"The lens is unknown{unread}. A field of view of {ASSUMED_FOV_DEG:.0f} degrees was assumed, and "
            f"distances will be wrong if it differs: {HOW_TO}.",
            remedy=remedy,
        )
    if drive.width_px < NARROW_PX:
        yield Finding(
            f"The images are {drive.width_px} pixels wide; below {NARROW_PX} pixels hardly any place is recognised, "
            "so a map may know only a small part of the drive.",
            remedy="Record larger images if the camera can.",
        )


def _depth(drive: DriveStatistics) -> Iterator[Finding]:
    if not drive.is_depth_registered:
        yield Finding(
            "The depth images are not registered to the colours; they were aligned by the two lenses alone, so depth "
            "is shifted by a few centimetres.",
            remedy="Name a registered stream with --depth, if there is one.",
        )
    if not drive.with_depth:
        yield _no_depth(drive)
    elif drive.with_depth < drive.frames:
        missing = drive.frames - drive.with_depth
        yield Finding(f"{missing} of {drive.frames} images have no depth; they are not used where depth is needed.")
    yield from _z_buffer(drive)
    median_m = drive.depth_median_m
    if median_m is not None and not NEAREST_MEDIAN_M <= median_m <= FARTHEST_MEDIAN_M:
        side = "nearer" if median_m < NEAREST_MEDIAN_M else "farther"
        yield Finding(
            f"Half of the depth is {side} than {median_m:.3g} m, where {NEAREST_MEDIAN_M:g} to {FARTHEST_MEDIAN_M:g} m "
            f"are usual, so the assumed unit is probably wrong: {HOW_TO_SCALE}."
        )


def _z_buffer(drive: DriveStatistics) -> Iterator[Finding]:
    low, high = drive.depth_range_m or (0.0, 0.0)
    if 0 < low < high <= 1 and high > Z_BUFFER_ABOVE:
        yield Finding(
            f"All depth lies between {low:.3g} and {high:.3g}, and no pixel is without: such numbers are usually not "
            "metres but the z-buffer of a renderer.",
            remedy="If they are, write metres: near * far / (far - z * (far - near)), with the near and far planes of "
            "the renderer.",
        )


def _no_depth(drive: DriveStatistics) -> Finding:
    less = "predictors that need it cannot use this drive, and the others estimate distances less well."
    unread, remedy = unread_text(drive.facts, "depth", "Record the depth camera too, if the robot has one.")
    found = "No depth was used" if unread else f"There is no depth among {_used(drive)}"
    return Finding(f"{found}{unread}: {less}", remedy=remedy)


def _used(drive: DriveStatistics) -> str:
    return ", ".join(drive.used_streams[:_MOST_NAMES]) or "images alone"


def _tilt(drive: DriveStatistics) -> Iterator[Finding]:
    tilt = drive.tilt
    if tilt is not None and abs(tilt.pitch_median_deg) > STEEP_DEG:
        way = "down" if tilt.pitch_median_deg < 0 else "up"
        yield Finding(
            f"The camera looks {way} by {abs(tilt.pitch_median_deg):.0f} degrees; a predictor for a level camera sees "
            "little of such images.",
            remedy="Use `--predictor geometric`, or mount the camera nearly level.",
        )
    if tilt is not None and tilt.roll_largest_deg > ROLLED_DEG:
        yield Finding(
            f"By its poses the camera rolls by up to {tilt.roll_largest_deg:.0f} degrees, and pitches from "
            f"{tilt.pitch_lowest_deg:.0f} to {tilt.pitch_highest_deg:.0f}.",
            remedy="If the quaternions are written with w first, write them as qx qy qz qw; if the poses are of the "
            "robot's body, turn them to the camera's optical frame (x right, y down, z forward).",
        )


def _odometry(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.odometry is OdometrySource.NONE:
        by_option = "Name the odometry with --odometry, if the robot has it."
        unread, remedy = unread_text(drive.facts, "odometry", by_option)
        yield Finding(
            f"There is no odometry among {_used(drive)}{unread}. All images have the same pose: only the predictor "
            "estimates distances between them, and its errors cannot be detected.",
            remedy=remedy,
        )
    if drive.is_spacing_ignored:
        yield Finding(
            "--every-m and --every-deg were ignored, because without odometry the motion of the camera is unknown: an "
            "image was kept if it had changed.",
            remedy=_KEEP_ALL,
        )
    if drive.odometry is OdometrySource.TRUTH:
        yield Finding(
            "The source has no odometry; the true poses replace it, so a map of this drive is better than one by wheel "
            "odometry."
        )
    if drive.drift is not None and drive.drift.per_metre > MUCH_DRIFT:
        yield Finding(
            f"Odometry deviates from the true poses by {drive.drift.per_metre:.0%} of the distance driven; is it in "
            "metres, of the same robot, and turned as x forward, y left?"
        )


def _frames(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.facts.assumed_rate_hz is not None:
        yield Finding(
            f"The images have no stamps; {drive.facts.assumed_rate_hz:g} per second were assumed, so times and speeds "
            "are wrong if they were taken at another rate.",
            remedy="Give it with --rate.",
        )
    if drive.frames < FEW_FRAMES:
        text = f"Only {drive.frames} images are left; a map needs a drive of some metres."
        yield Finding(text, remedy=_thinned(drive))
    if len(drive.gaps_s) >= MANY_GAPS or sum(drive.gaps_s) > MANY_GAPS * 10:
        yield Finding(
            f"For {len(drive.gaps_s)} times, {sum(drive.gaps_s):.0f} s in all, there are no images; did the recorder "
            "lose messages?"
        )


def _overlap(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.coverage is None or drive.frames < 2:
        return
    steps = np.diff(drive.poses, axis=0)
    apart = np.hypot(steps[:, 0], steps[:, 1]) > NEAR_M
    apart |= np.abs(wrap_angle(steps[:, 2])) > drive.field_of_view_rad / 2
    if apart.mean() > _APART_SHARE:
        yield Finding(
            f"{apart.sum()} of {len(apart)} images do not overlap with the one before: they are farther than {NEAR_M} "
            "m apart, or turned by more than half of the field of view.",
            remedy="If its poses are in metres and radians, drive slower, or record more images per second. "
            f"{_thinned(drive)}".rstrip(),
        )
    if drive.coverage.pieces > 1:
        yield Finding(
            f"By its poses the drive consists of {drive.coverage.pieces} pieces, the largest with "
            f"{drive.coverage.largest_share:.0%} of the images. Neither near images nor odometry join the pieces, so "
            "a map will be in pieces too. Are the gaps or jumps real?",
            remedy="Drive the missing routes, and return to where you began.",
        )


def _thinned(drive: DriveStatistics) -> str:
    """Return a note on how to keep more images; empty if none was left out for too little motion."""
    if not drive.thinned:
        return ""
    if drive.odometry is OdometrySource.NONE:
        return f"{drive.thinned} were left out because the image had hardly changed. {_KEEP_ALL}"
    return f"{drive.thinned} were left out for too little motion; lower --every-m and --every-deg to keep more."


def _dropped(drive: DriveStatistics) -> Iterator[Finding]:
    wrong = sum(drive.dropped_as_wrong.values())
    if wrong > _DROPPED_SHARE * (drive.frames + wrong):
        causes = dict.fromkeys(_CAUSES.get(reason, _OTHER_CAUSE) for reason in drive.dropped_as_wrong)
        if said := " ".join(cause for cause in causes if cause):
            yield Finding(f"{wrong} images could not be used, see `dropped` for the reasons. {said}")
