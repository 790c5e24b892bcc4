"""Small drives in other people's formats, for tests. What a camera sees is a function of the direction alone."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.raw_frame import DriveFacts, RawFrame, SourceFact
from tests.repository import ROOT

EXCERPT = ROOT / "tests/data/tum_excerpt"
"""Twelve frames of a real drive, with depth and true poses."""

FORWARD = "0.5 -0.5 0.5 -0.5"
"""The quaternion of an optical frame that looks along the world's x, level."""


def sight(camera: CameraModel) -> NDArray[np.uint8]:
    """Return what a camera sees, (H, W, 3): colours that change smoothly with the direction in the robot's frame."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = camera.pixels_to_rays(np.stack([columns, rows], axis=-1))
    body = np.concatenate([np.ones((*rays.shape[:2], 1)), -rays], axis=-1) @ camera.rotation.T
    body /= np.linalg.norm(body, axis=-1, keepdims=True)
    return np.nan_to_num(128 + 100 * np.sin(6 * body[..., [1, 2, 1]] + [0, 0, 2])).astype(np.uint8)


class ListedDrive:
    """A reader of frames that lie in a list. Implements `DriveReader`."""

    def __init__(self, frames: Iterable[RawFrame], roles: Sequence[str] = ("rgb",)) -> None:
        self._frames = list(frames)
        streams = [SourceFact(role, f"/{role}", len(self._frames), 10.0) for role in roles]
        self.facts = DriveFacts(
            format="list", frames=len(self._frames), streams=streams, place="yard", odometry_frame="odom"
        )
        self.dropped: Mapping[str, int] = {}
        self.doubts: Sequence[str] = ()

    def frames(self) -> Iterator[RawFrame]:
        yield from self._frames


def write_tum_folder(
    folder: Path,
    *,
    frames: int = 4,
    depth_delay_s: float | None = 0.0,
    pose_lines: Iterable[str] | None = None,
    size: tuple[int, int] = (64, 48),
) -> Path:
    """Write a folder in TUM's layout, ten images a second, 0.2 m apart along the world's x."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    stamps = [100 + k / 10 for k in range(frames)]
    for stamp in stamps:
        cv2.imwrite(str(folder / f"rgb/{stamp:.2f}.png"), rng.integers(0, 255, (size[1], size[0], 3), np.uint8))
        cv2.imwrite(str(folder / f"depth/{stamp:.2f}.png"), np.full((size[1], size[0]), 10_000, np.uint16))
    (folder / "rgb.txt").write_text(
        "# colours\n" + "".join(f"{s:.4f} rgb/{s:.2f}.png\n" for s in stamps), encoding="utf-8"
    )
    if depth_delay_s is not None:
        lines = (f"{s + depth_delay_s:.4f} depth/{s:.2f}.png\n" for s in stamps)
        (folder / "depth.txt").write_text("".join(lines), encoding="utf-8")
    poses = [f"{s:.4f} {0.2 * k:.2f} 1 0.5 {FORWARD}" for k, s in enumerate(stamps)]
    (folder / "groundtruth.txt").write_text("\n".join(poses if pose_lines is None else pose_lines), encoding="utf-8")
    return folder
