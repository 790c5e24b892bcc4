"""Perturbations of a robot's camera: functions of one observation, with a strength in physical units.

Owns their names and a robot with such a camera. Colours are converted to linear light, by a power of 2.2, and back.
Perturbations of colours do not change depth.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import rectification
from ltvn_core.errors import OptionError
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_view import RobotView
from ltvn_core.types import Observation, Rgb

_GAMMA = 2.2


def motion_blur(
    seen: Observation, rng: np.random.Generator, camera: CameraModel, *, swept_rad: float = 0.03
) -> Observation:
    """Blur along the rows, because the robot turns while the shutter is open.

    `swept_rad` is the camera's rotation during one exposure: one radian per second for 30 ms.
    """
    length = max(round(swept_rad * camera.fx), 1)
    streak = np.full((1, length), 1 / length, np.float32)
    light = cv2.filter2D(_light(seen.rgb), -1, streak, borderType=cv2.BORDER_REPLICATE)
    return _with_light(seen, np.asarray(light, np.float32))


def wrong_exposure(
    seen: Observation, rng: np.random.Generator, camera: CameraModel, *, stops: float = 1.5
) -> Observation:
    """Expose for a wrong time, as after the step from a corridor to a window.

    `stops` is the error, each a factor of two in light, up or down.
    """
    return _with_light(seen, _light(seen.rgb) * 2.0 ** float(rng.choice([-stops, stops])))


def flare(
    seen: Observation,
    rng: np.random.Generator,
    camera: CameraModel,
    *,
    spot_rad: float = math.radians(8),
    spot_light: float = 2.0,
    veil_light: float = 0.15,
) -> Observation:
    """Show a lamp or the sun in the lens: a bright spot in the upper half, and a veil over the whole image.

    Light has fallen to 60 % at the spot's radius `spot_rad`; light 1 makes a pixel white.
    """
    height, width = seen.rgb.shape[:2]
    column = rng.uniform(0, width)
    row = rng.uniform(0, height / 2)
    rows, columns = np.mgrid[:height, :width]
    away_rad = np.hypot((columns - column) / camera.fx, (rows - row) / camera.fy)
    added = veil_light + spot_light * np.exp(-0.5 * (away_rad / spot_rad) ** 2)
    return _with_light(seen, _light(seen.rgb) + added[..., None].astype(np.float32))


def sensor_noise(
    seen: Observation,
    rng: np.random.Generator,
    camera: CameraModel,
    *,
    full_well: float = 400.0,
    read_noise: float = 4.0,
) -> Observation:
    """Add the noise of a sensor that receives few photons, as in a dark room; it grows with the root of the light.

    `full_well` photons make a pixel white, ten thousand in a good image; `read_noise` is the standard deviation of
    reading a pixel, in photons.
    """
    photons = _light(seen.rgb) * full_well
    noisy = photons + np.sqrt(photons + read_noise**2) * rng.standard_normal(photons.shape, np.float32)
    return _with_light(seen, noisy / full_well)


def wrong_white_balance(
    seen: Observation, rng: np.random.Generator, camera: CameraModel, *, gain: float = 1.35
) -> Observation:
    """Take the image too warm or too cold, between lamp light and daylight.

    `gain` is the factor by which red grows while blue shrinks, or the reverse; 1.35 is about 1,500 kelvin.
    """
    warm = gain if rng.random() < 0.5 else 1 / gain
    return _with_light(seen, _light(seen.rgb) * np.array([warm, 1.0, 1 / warm], np.float32))


def strong_compression(
    seen: Observation, rng: np.random.Generator, camera: CameraModel, *, quality: int = 15
) -> Observation:
    """Compress to JPEG of low quality (0 to 100), as over a poor link."""
    _, jpeg = cv2.imencode(".jpg", seen.rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, quality))
    rgb = cv2.imdecode(jpeg, cv2.IMREAD_COLOR_RGB)
    return replace(seen, rgb=np.asarray(rgb, np.uint8), original=None)


def _light(rgb: Rgb) -> NDArray[np.float32]:
    """Return the linear light (H, W, 3) of a picture; 1 makes a pixel white."""
    return (rgb.astype(np.float32) / np.float32(255)) ** np.float32(_GAMMA)


def _with_light(seen: Observation, light: NDArray[np.floating]) -> Observation:
    rgb = np.clip(light, 0, 1) ** (1 / _GAMMA) * 255
    return replace(seen, rgb=np.rint(rgb).astype(np.uint8), original=None)


_HOLES_AT_ONCE = 4
_MOST_TRIES = 100


def depth_holes(
    seen: Observation,
    rng: np.random.Generator,
    camera: CameraModel,
    *,
    share: float = 0.4,
    noise_per_m: float = 0.003,
) -> Observation:
    """Make holes in depth, as on glass, shiny and black surfaces, and noise elsewhere; without depth change nothing.

    `share` is that of the pixels in holes; `noise_per_m` is the standard deviation at 1 m, in metres, which grows with
    the square of the depth, as in a structured-light camera. Holes are ellipses of up to a fifth of the width.
    """
    if seen.depth is None:
        return seen
    spread = noise_per_m * seen.depth**2
    depth = np.maximum(seen.depth + spread * rng.standard_normal(seen.depth.shape, np.float32), 0)
    shape: tuple[int, ...] = seen.depth.shape
    holes = np.zeros(shape, np.uint8)
    height, width = shape
    for _ in range(_MOST_TRIES):
        if holes.mean() >= share:
            break
        for _ in range(_HOLES_AT_ONCE):
            centre = int(rng.integers(width)), int(rng.integers(height))
            axes = int(rng.integers(1, max(width // 10, 2))), int(rng.integers(1, max(height // 10, 2)))
            cv2.ellipse(holes, centre, axes, float(rng.uniform(0, 180)), 0, 360, 1, thickness=-1)
    return replace(seen, depth=np.where(holes.astype(bool), 0, depth).astype(np.float32))


def other_lens(
    seen: Observation,
    rng: np.random.Generator,
    camera: CameraModel,
    *,
    focal_factor: float = 1.06,
    barrel: float = -0.08,
) -> Observation:
    """Look through a lens that differs from the calibrated `camera`: a longer focal length, uncorrected distortion.

    `focal_factor` is the ratio of the focal lengths, `barrel` the first radial coefficient k1.
    """
    other = replace(
        camera,
        fx=camera.fx * focal_factor,
        fy=camera.fy * focal_factor,
        distortion=(barrel, 0.0, 0.0, 0.0),
        fisheye=False,
    )
    way = rectification(camera, other)
    depth = None if seen.depth is None else way.rectify_depth(seen.depth)
    return replace(seen, rgb=way.rectify_rgb(seen.rgb), depth=depth, original=None)


@dataclass(frozen=True, slots=True)
class FrameLoss:
    """Bursts of lost frames, as over a busy link."""

    share: float = 0.4
    """Share of lost frames."""
    burst: float = 6.0
    """Mean number of consecutive lost frames."""

    def is_lost(self, rng: np.random.Generator, *, was_lost: bool) -> bool:
        """Draw whether the next frame is lost."""
        ends = 1 / self.burst
        begins = ends * self.share / (1 - self.share)
        return bool(rng.random() < (1 - ends if was_lost else begins))


DROPPED_FRAMES = "dropped-frames"
"""Name of the loss of frames, which `FrameLoss` draws; not in the table, because it changes no image."""
ALL = "all"


Perturbation: TypeAlias = Callable[[Observation, np.random.Generator, CameraModel], Observation]
"""Returns a worse observation of the same size, taken by a camera; the argument is not changed."""

_TABLE: Mapping[str, Perturbation] = {
    "blur": motion_blur,
    "exposure": wrong_exposure,
    "flare": flare,
    "depth-holes": depth_holes,
    "lens": other_lens,
    "noise": sensor_noise,
    "white-balance": wrong_white_balance,
    "jpeg": strong_compression,
}

PERTURBATIONS = (*_TABLE, DROPPED_FRAMES)
"""All names of perturbations."""


def chosen_perturbations(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of perturbations, each once; `all` stands for all of them.

    Raises OptionError for an unknown name.
    """
    chosen = tuple(dict.fromkeys(names))
    if chosen == (ALL,):
        return PERTURBATIONS
    if unknown := [name for name in chosen if name not in PERTURBATIONS]:
        raise OptionError(
            f"There is no perturbation {', '.join(unknown)}; --perturb takes one or several of "
            f"{' '.join(PERTURBATIONS)}, separated by spaces, or {ALL}."
        )
    return chosen


def perturb(name: str, seen: Observation, rng: np.random.Generator, camera: CameraModel) -> Observation:
    """Return a worse observation; `name` is one of `PERTURBATIONS` but not `DROPPED_FRAMES`."""
    return _TABLE[name](seen, rng, camera)


class PerturbedRobot(RobotView):
    """A robot with perturbations of its camera.

    A lost frame is replaced by the image of the last one that arrived, with the current odometry.
    """

    def __init__(self, robot: Robot, perturbations: Sequence[str], *, seed: int) -> None:
        """Apply all of `perturbations`, names of `PERTURBATIONS`, to each image; `seed` draws their random parts."""
        super().__init__(robot)
        self._seed = seed
        self._names = [name for name in perturbations if name != DROPPED_FRAMES]
        self._loss = FrameLoss() if DROPPED_FRAMES in perturbations else None
        self._lost = False

    def _changed(self, taken: Observation) -> Observation:
        rng = np.random.default_rng([self._seed, abs(taken.step)])
        last = self._shown
        if self._loss is not None and last is not None:
            self._lost = self._loss.is_lost(rng, was_lost=self._lost)
            if self._lost:
                return replace(taken, rgb=last.rgb, depth=last.depth, original=last.original)
        for name in self._names:
            taken = perturb(name, taken, rng, self.spec.camera)
        return taken
