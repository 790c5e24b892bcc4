"""What an import brings home: its summary, as people and programs read it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.importing.drive_findings import Drift, DriveStatistics, TiltRange, path_m
from ltvn_core.importing.drive_odometry import OdometrySource
from ltvn_core.importing.raw_frame import DriveFacts


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
    """Above the floor; 0 where nobody says."""
    pitch_deg: float
    is_lens_known: bool
    """False where the field of view was assumed."""

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
    """What an import found, left out and wrote."""

    recording: Path
    format: str
    """Name of the reader."""
    scene: str
    """What the recording calls the place."""
    frames: int
    """Images of the recording."""
    dropped: Mapping[str, int]
    """Images that were left out, by reason."""
    without_depth: int
    """Images of the recording without any depth."""
    rates_hz: Mapping[str, float]
    """How many images, poses and the like the source has a second."""
    camera: ImportedCamera
    odometry: OdometrySource
    """Where the recorded odometry comes from."""
    seconds: float
    """From the first to the last image, on the source's clock."""
    path_m: float | None
    """Length of the way by odometry; None where there is none."""
    pieces_expected: int | None
    """Parts that a map would fall into at best: near images joined, and by odometry those in a row; None without
    poses."""
    largest_piece_expected: float | None
    """Share of the images in the largest of them."""
    revisited_share: float | None
    """Share of the images that show a place where the drive had been before: loops."""
    gaps: int
    """Pauses between images that are much longer than usual,"""
    longest_gap_s: float
    tilt: TiltRange | None
    """How the camera was tilted, where that changes."""
    drift: Drift | None
    """How odometry strays from the true poses, where the source has both."""
    findings: tuple[Finding, ...]
    """What is doubtful, with the likely cause and what to do; nothing where all is well."""
    next_step: str
    """What to do now, and what that will tell."""


def import_summary(
    found: DriveStatistics,
    *,
    recording: Path,
    facts: DriveFacts,
    scene: str,
    dropped: Mapping[str, int],
    camera: CameraModel,
    seconds: float,
    findings: tuple[Finding, ...],
) -> ImportSummary:
    """Put a summary together."""
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
        findings=findings,
        next_step=(
            f"`ltvn build {recording} --output map.rrd` makes a map, and its `known_share` says of how much of the "
            "drive the map knows the place; below 80 % it says where, and likely causes."
        ),
    )
