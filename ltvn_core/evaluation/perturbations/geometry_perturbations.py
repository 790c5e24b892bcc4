"""What goes wrong beside colours: depth with holes and noise, a lens that is not the calibrated one, lost frames."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import rectification
from ltvn_core.types import Observation

_HOLES_AT_ONCE = 4
_MOST_TRIES = 100


@dataclass(frozen=True, slots=True)
class DepthHoles:
    """Glass, shine and black surfaces return nothing, and what does return is noisy."""

    share: float = 0.4
    """Share of the pixels in holes."""
    noise_per_m: float = 0.003
    """Standard deviation of depth, as a share of it per metre: a structured-light camera's grows with the square."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation with worse depth; one without depth as it is."""
        if seen.depth is None:
            return seen
        spread = self.noise_per_m * seen.depth**2
        depth = np.maximum(seen.depth + spread * rng.standard_normal(seen.depth.shape, np.float32), 0)
        return replace(seen, depth=np.where(self._holes(seen.depth.shape, rng), 0, depth).astype(np.float32))

    def _holes(self, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.bool_]:
        """Return which pixels (H, W) are in holes: ellipses of up to a fifth of the picture's width."""
        holes = np.zeros(shape, np.uint8)
        height, width = shape
        for _ in range(_MOST_TRIES):
            if holes.mean() >= self.share:
                break
            for _ in range(_HOLES_AT_ONCE):
                centre = int(rng.integers(width)), int(rng.integers(height))
                axes = int(rng.integers(1, max(width // 10, 2))), int(rng.integers(1, max(height // 10, 2)))
                cv2.ellipse(holes, centre, axes, float(rng.uniform(0, 180)), 0, 360, 1, thickness=-1)
        return holes.astype(bool)


@dataclass(frozen=True, slots=True)
class OtherLens:
    """The lens is not the one that was calibrated: a little longer, and with barrel distortion that nobody corrects."""

    camera: CameraModel
    """As calibrated."""
    focal_factor: float = 1.06
    """Its focal length against the calibrated one."""
    barrel: float = -0.08
    """Its first radial coefficient, k1."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation as the other lens takes it."""
        other = replace(
            self.camera,
            fx=self.camera.fx * self.focal_factor,
            fy=self.camera.fy * self.focal_factor,
            distortion=(self.barrel, 0.0, 0.0, 0.0),
            fisheye=False,
        )
        way = rectification(self.camera, other)
        depth = None if seen.depth is None else way.rectify_depth(seen.depth)
        return replace(seen, rgb=way.rectify_rgb(seen.rgb), depth=depth, original=None)


@dataclass(frozen=True, slots=True)
class FrameLoss:
    """Frames do not arrive, several in a row, as over a busy link."""

    share: float = 0.4
    """Of all frames."""
    burst: float = 6.0
    """Frames that are lost in a row, on average."""

    def is_lost(self, rng: np.random.Generator, *, was_lost: bool) -> bool:
        """Draw whether the next frame is lost."""
        ends = 1 / self.burst
        begins = ends * self.share / (1 - self.share)
        return bool(rng.random() < (1 - ends if was_lost else begins))

    def lost(self, count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Draw which frames (N,) of a drive are lost."""
        lost = np.zeros(count, bool)
        for k in range(1, count):
            lost[k] = self.is_lost(rng, was_lost=bool(lost[k - 1]))
        return lost
