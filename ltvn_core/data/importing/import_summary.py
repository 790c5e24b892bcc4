"""The summary of an import, for people and programs, and its findings about the drive.

Owns the limits above which something is doubtful, the likely cause, and the advice. Does not reject any drive.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.drive_statistics import (
    MOST_NAMES,
    NO_ODOMETRY,
    NO_TRUTH,
    STAMP_NOT_AFTER,
    TOO_LITTLE_MOTION,
    Drift,
    DriveStatistics,
    TiltRange,
)
from ltvn_core.data.importing.frame_preparation import ASSUMED_FOV_DEG
from ltvn_core.data.importing.import_options import OdometrySource
from ltvn_core.data.importing.raw_frame import NO_DEPTH, NO_POSE, NOT_LATER, DriveFacts
from ltvn_core.data.importing.source_camera import HOW_TO, HOW_TO_SCALE
from ltvn_core.data.revisits import NEAR_M
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


def _described(camera: CameraModel, *, is_lens_known: bool) -> ImportedCamera:
    return ImportedCamera(
        width=camera.width,
        height=camera.height,
        **{name: round(getattr(camera, name), 3) for name in ("fx", "fy", "cx", "cy", "height_m")},
        horizontal_fov_deg=round(math.degrees(camera.horizontal_fov_rad), 2),
        vertical_fov_deg=round(math.degrees(camera.vertical_fov_rad), 2),
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
    found: DriveStatistics, *, recording: Path, scene: str, camera: CameraModel, told: Sequence[Finding]
) -> ImportSummary:
    """Return the summary, from the statistics and the findings `told` of earlier steps."""
    coverage = found.coverage
    gaps_s = found.gaps_s
    streams = found.facts.streams
    return ImportSummary(
        recording=recording,
        format=found.facts.format,
        scene=scene,
        frames=found.frames,
        dropped=found.dropped,
        without_depth=found.frames - found.with_depth,
        rates_hz={each.role: round(each.rate_hz, 2) for each in streams if each.role and each.rate_hz},
        camera=_described(camera, is_lens_known=found.preparation.is_lens_known),
        odometry=found.odometry,
        seconds=found.stamps[-1] - found.stamps[0],
        path_m=found.path_m if coverage else None,
        pieces_expected=coverage.pieces if coverage else None,
        largest_piece_expected=coverage.largest_share if coverage else None,
        revisited_share=coverage.revisited_share if coverage else None,
        gaps=len(gaps_s),
        longest_gap_s=max(gaps_s, default=0.0),
        tilt=found.tilt,
        drift=found.drift,
        findings=(*told, *(Finding(text, remedy=remedy) for holds, text, remedy in _rows(found) if holds)),
        next_step=(
            f"`ltvn build {recording} --output map.rrd` makes a map. Its `known_share` is the share of the drive that "
            "the map recognises; below 80 % it also lists where it fails, and likely causes."
        ),
    )


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
    names = ", ".join(stream.described for stream in unread[:MOST_NAMES])
    return f"; not read: {names}", " ".join(dict.fromkeys(stream.remedy or by_option for stream in unread))


def _rows(drive: DriveStatistics) -> Iterator[tuple[bool, str, str]]:
    """Yield each condition with its text and remedy; a text is complete only where its condition holds."""
    lens, lens_remedy = unread_text(drive.facts, "camera_info", "")
    depth, depth_remedy = unread_text(drive.facts, "depth", "Record the depth camera too, if the robot has one.")
    odometry, odometry_remedy = unread_text(
        drive.facts, "odometry", "Name the odometry with --odometry, if the robot has it."
    )
    yield (
        not drive.preparation.is_lens_known,
        f"The lens is unknown{lens}. A field of view of {ASSUMED_FOV_DEG:.0f} degrees was assumed, and distances will "
        f"be wrong if it differs: {HOW_TO}.",
        lens_remedy,
    )
    width_px = drive.preparation.camera.width
    yield (
        width_px < NARROW_PX,
        f"The images are {width_px} pixels wide; below {NARROW_PX} pixels hardly any place is recognised, so a "
        "map may know only a small part of the drive.",
        "Record larger images if the camera can.",
    )
    yield (
        not drive.preparation.is_depth_registered,
        "The depth images are not registered to the colours; they were aligned by the two lenses alone, so depth is "
        "shifted by a few centimetres.",
        "Name a registered stream with --depth, if there is one.",
    )
    yield (
        not drive.with_depth,
        f"{'No depth was used' if depth else f'There is no depth among {drive.used_streams}'}{depth}: predictors that "
        "need it cannot use this drive, and the others estimate distances less well.",
        depth_remedy,
    )
    yield (
        0 < drive.with_depth < drive.frames,
        f"{drive.frames - drive.with_depth} of {drive.frames} images have no depth; they are not used where depth is "
        "needed.",
        "",
    )
    low, high = drive.nearest_m, drive.farthest_m
    yield (
        0 < low < high <= 1 and high > Z_BUFFER_ABOVE,
        f"All depth lies between {low:.3g} and {high:.3g}, and no pixel is without: such numbers are usually not "
        "metres but the z-buffer of a renderer.",
        "If they are, write metres: near * far / (far - z * (far - near)), with the near and far planes of the "
        "renderer.",
    )
    median_m = drive.depth_median_m or NEAREST_MEDIAN_M
    yield (
        not NEAREST_MEDIAN_M <= median_m <= FARTHEST_MEDIAN_M,
        f"Half of the depth is {'nearer' if median_m < NEAREST_MEDIAN_M else 'farther'} than {median_m:.3g} m, where "
        f"{NEAREST_MEDIAN_M:g} to {FARTHEST_MEDIAN_M:g} m are usual, so the assumed unit is probably wrong: "
        f"{HOW_TO_SCALE}.",
        "",
    )
    if (tilt := drive.tilt) is not None:
        yield (
            abs(tilt.pitch_median_deg) > STEEP_DEG,
            f"The camera looks {'down' if tilt.pitch_median_deg < 0 else 'up'} by {abs(tilt.pitch_median_deg):.0f} "
            "degrees; a predictor for a level camera sees little of such images.",
            "Use `--predictor geometric`, or mount the camera nearly level.",
        )
        yield (
            tilt.roll_largest_deg > ROLLED_DEG,
            f"By its poses the camera rolls by up to {tilt.roll_largest_deg:.0f} degrees, and pitches from "
            f"{tilt.pitch_lowest_deg:.0f} to {tilt.pitch_highest_deg:.0f}.",
            "If the quaternions are written with w first, write them as qx qy qz qw; if the poses are of the robot's "
            "body, turn them to the camera's optical frame (x right, y down, z forward).",
        )
    yield (
        drive.odometry is OdometrySource.NONE,
        f"There is no odometry among {drive.used_streams}{odometry}. All images have the same pose: only the "
        "predictor estimates distances between them, and its errors cannot be detected.",
        odometry_remedy,
    )
    yield (
        drive.is_spacing_ignored,
        "--every-m and --every-deg were ignored, because without odometry the motion of the camera is unknown: an "
        "image was kept if it had changed.",
        _KEEP_ALL,
    )
    yield (
        drive.odometry is OdometrySource.TRUTH,
        "The source has no odometry; the true poses replace it, so a map of this drive is better than one by wheel "
        "odometry.",
        "",
    )
    if (drift := drive.drift) is not None:
        yield (
            drift.per_metre > MUCH_DRIFT,
            f"Odometry deviates from the true poses by {drift.per_metre:.0%} of the distance driven; is it in metres, "
            "of the same robot, and turned as x forward, y left?",
            "",
        )
    yield (
        drive.facts.assumed_rate_hz is not None,
        f"The images have no stamps; {drive.facts.assumed_rate_hz or 0:g} per second were assumed, so times and "
        "speeds are wrong if they were taken at another rate.",
        "Give it with --rate.",
    )
    yield (
        drive.frames < FEW_FRAMES,
        f"Only {drive.frames} images are left; a map needs a drive of some metres.",
        _thinned(drive),
    )
    gaps_s = drive.gaps_s
    yield (
        len(gaps_s) >= MANY_GAPS or sum(gaps_s) > MANY_GAPS * 10,
        f"For {len(gaps_s)} times, {sum(gaps_s):.0f} s in all, there are no images; did the recorder lose messages?",
        "",
    )
    if (coverage := drive.coverage) is not None and drive.frames > 1:
        steps = np.diff(drive.poses, axis=0)
        apart = np.hypot(steps[:, 0], steps[:, 1]) > NEAR_M
        apart |= np.abs(wrap_angle(steps[:, 2])) > drive.preparation.camera.horizontal_fov_rad / 2
        yield (
            bool(apart.mean() > _APART_SHARE),
            f"{apart.sum()} of {len(apart)} images do not overlap with the one before: they are farther than {NEAR_M} "
            "m apart, or turned by more than half of the field of view.",
            "If its poses are in metres and radians, drive slower, or record more images per second. "
            f"{_thinned(drive)}".rstrip(),
        )
        yield (
            coverage.pieces > 1,
            f"By its poses the drive consists of {coverage.pieces} pieces, the largest with "
            f"{coverage.largest_share:.0%} of the images. Neither near images nor odometry join the pieces, so a map "
            "will be in pieces too. Are the gaps or jumps real?",
            "Drive the missing routes, and return to where you began.",
        )
    wrong = {reason: count for reason, count in drive.dropped.items() if reason != TOO_LITTLE_MOTION}
    causes = " ".join(filter(None, dict.fromkeys(_CAUSES.get(reason, _OTHER_CAUSE) for reason in wrong)))
    yield (
        causes != "" and sum(wrong.values()) > _DROPPED_SHARE * (drive.frames + sum(wrong.values())),
        f"{sum(wrong.values())} images could not be used, see `dropped` for the reasons. {causes}",
        "",
    )


def _thinned(drive: DriveStatistics) -> str:
    """Return a note on how to keep more images; empty if none was left out for too little motion."""
    thinned = drive.dropped.get(TOO_LITTLE_MOTION, 0)
    if not thinned:
        return ""
    if drive.odometry is OdometrySource.NONE:
        return f"{thinned} were left out because the image had hardly changed. {_KEEP_ALL}"
    return f"{thinned} were left out for too little motion; lower --every-m and --every-deg to keep more."
