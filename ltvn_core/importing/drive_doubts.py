"""What is doubtful of a drive that comes in, in words: the likely cause and what to do. Refuses nothing."""

from collections.abc import Iterator

import numpy as np

from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.revisits import NEAR_M
from ltvn_core.importing.drive_findings import DriveFindings
from ltvn_core.importing.drive_odometry import OdometrySource
from ltvn_core.importing.frame_preparation import ASSUMED_FOV_DEG
from ltvn_core.importing.source_camera import HOW_TO, HOW_TO_SCALE

STEEP_DEG = 20.0
"""A predictor that looks level sees less than two thirds of a picture that is tilted by more."""
ROLLED_DEG = 60.0
"""No robot carries a camera that is rolled by more, if it holds it upright at all."""
NARROW_PX = 160
"""In narrower images the geometric predictor, which real ones are compared by, finds too little."""
NEAREST_MEDIAN_M, FARTHEST_MEDIAN_M = 0.1, 10.0
"""Half of what a depth camera sees from a robot is farther than the first and nearer than the second."""
MUCH_DRIFT = 0.15
FEW_FRAMES = 20
MANY_GAPS = 3
_MOST_NAMES = 10
_KEEP_ALL = "--every-m 0 --every-deg 0 keeps every image."
_APART_SHARE = 0.1
_DROPPED_SHARE = 0.1


def drive_doubts(found: DriveFindings) -> Iterator[str]:
    """Yield what is doubtful, in whole sentences."""
    yield from _camera_doubts(found)
    yield from _odometry_doubts(found)
    yield from _overlap_doubts(found)
    if found.dropped_as_wrong > _DROPPED_SHARE * (found.frames + found.dropped_as_wrong):
        yield (
            f"{found.dropped_as_wrong} images could not be used, see `dropped` for the reasons; is the file cut, or "
            "were its streams recorded by different clocks?"
        )


def _camera_doubts(found: DriveFindings) -> Iterator[str]:
    if not found.is_lens_known:
        yield (
            f"Nothing says what lens took the images; {ASSUMED_FOV_DEG:.0f} degrees were assumed, and distances will "
            f"be wrong by as much as that is: {HOW_TO}."
        )
    if found.width_px < NARROW_PX:
        yield (
            f"The images are {found.width_px} pixels wide, and in less than {NARROW_PX} hardly anything is recognised; "
            "a map of them may know a small part of the drive. Record larger images where the camera can."
        )
    if not found.is_depth_registered:
        yield (
            "The depth images are not registered to the colours; they were laid over them by the two lenses alone, and "
            "lie a few centimetres off. Name a registered stream by --depth where there is one."
        )
    if not found.with_depth:
        yield _no_depth(found)
    elif found.with_depth < found.frames:
        missing = found.frames - found.with_depth
        yield f"{missing} of {found.frames} images have no depth, and are not used where it is needed."
    yield from _depth_unit_doubts(found)
    if found.tilt is not None and abs(found.tilt.pitch_median_deg) > STEEP_DEG:
        way = "down" if found.tilt.pitch_median_deg < 0 else "up"
        yield (
            f"The camera looks {way} by {abs(found.tilt.pitch_median_deg):.0f} degrees; a predictor for a level camera "
            "sees little of such images. Use `--predictor geometric`, or mount the camera nearly level."
        )
    if found.tilt is not None and found.tilt.roll_largest_deg > ROLLED_DEG:
        yield (
            f"By its poses the camera rolls by up to {found.tilt.roll_largest_deg:.0f} degrees, and pitches from "
            f"{found.tilt.pitch_lowest_deg:.0f} to {found.tilt.pitch_highest_deg:.0f}. If the quaternions are written "
            "with w first, write them as qx qy qz qw; if the poses are of the robot's body, turn them to the camera's "
            "optical frame (x right, y down, z forward)."
        )


def _depth_unit_doubts(found: DriveFindings) -> Iterator[str]:
    if found.depth_median_m is None or NEAREST_MEDIAN_M <= found.depth_median_m <= FARTHEST_MEDIAN_M:
        return
    side = "nearer" if found.depth_median_m < NEAREST_MEDIAN_M else "farther"
    yield (
        f"Half of the depth is {side} than {found.depth_median_m:.3g} m, where {NEAREST_MEDIAN_M:g} to "
        f"{FARTHEST_MEDIAN_M:g} m are usual, so its unit is probably another: {HOW_TO_SCALE}."
    )


def _no_depth(found: DriveFindings) -> str:
    less = "predictors that need it cannot use this drive, and the others estimate distances less well."
    if found.possible_depths:
        names = ", ".join(found.possible_depths[:_MOST_NAMES])
        return f"No depth was used: {less} It could be in {names}; name the right one by --depth."
    used = ", ".join(found.used_streams[:_MOST_NAMES]) or "images alone"
    return f"There is no depth among {used}: {less} Record the depth camera too where the robot has one."


def _odometry_doubts(found: DriveFindings) -> Iterator[str]:
    if found.odometry is OdometrySource.NONE:
        yield (
            "There is no odometry, so all images are recorded at one place: distances between them are what the "
            "predictor says, and nothing contradicts it. Give odometry by --odometry where the robot has some."
        )
    if found.is_spacing_ignored:
        yield (
            "--every-m and --every-deg were ignored, for without odometry nobody knows how far the camera moved: an "
            f"image was kept where the picture had changed. {_KEEP_ALL}"
        )
    if found.odometry is OdometrySource.TRUTH:
        yield (
            "There is no odometry of its own; the true poses stand in for it, so a map of this drive is better than "
            "wheels would make it."
        )
    if found.drift is not None and found.drift.per_metre > MUCH_DRIFT:
        yield (
            f"Odometry strays from the true poses by {found.drift.per_metre:.0%} of the way; is it in metres, of the "
            "same robot, and turned as x forward, y left?"
        )


def _overlap_doubts(found: DriveFindings) -> Iterator[str]:
    if found.frames < FEW_FRAMES:
        yield f"Only {found.frames} images are left; a map needs a drive of some metres.{_thinned(found)}"
    if len(found.gaps_s) >= MANY_GAPS or sum(found.gaps_s) > MANY_GAPS * 10:
        yield (
            f"For {len(found.gaps_s)} times, {sum(found.gaps_s):.0f} s in all, no images came; did the recorder lose "
            "messages?"
        )
    if found.coverage is None or found.frames < 2:
        return
    steps = np.diff(found.poses, axis=0)
    apart = np.hypot(steps[:, 0], steps[:, 1]) > NEAR_M
    apart |= np.abs(wrap_angle(steps[:, 2])) > found.field_of_view_rad / 2
    if apart.mean() > _APART_SHARE:
        yield (
            f"{apart.sum()} of {len(apart)} images in a row do not overlap with the one before: farther than {NEAR_M} "
            "m, or turned by more than half of what the camera sees. Drive slower, or record more images a second."
            f"{_thinned(found)}"
        )
    if found.coverage.pieces > 1:
        yield (
            f"By its poses the drive falls into {found.coverage.pieces} pieces, the largest with "
            f"{found.coverage.largest_share:.0%} of the images, and a map will fall apart likewise, for neither near "
            "images nor odometry join them. Do the gaps or jumps belong there? Drive the missing ways, and come back "
            "to where you began."
        )


def _thinned(found: DriveFindings) -> str:
    """Return how more of the images are kept; nothing where none was left out for that."""
    if not found.thinned:
        return ""
    if found.odometry is OdometrySource.NONE:
        return f" {found.thinned} were left out because the picture had hardly changed. {_KEEP_ALL}"
    return f" {found.thinned} were left out for too little motion; lower --every-m and --every-deg to keep more."
