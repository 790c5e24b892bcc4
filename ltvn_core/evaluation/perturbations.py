"""Perturbations of a robot's camera: functions of one observation, with a strength in physical units.

Owns their names and a robot with such a camera. Colours are converted to linear light, by a power of 2.2, and back.
Perturbations of colours do not change depth.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

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


@dataclass(frozen=True, slots=True)
class MotionBlur:
    """Motion blur along the rows, because the robot turns while the shutter is open."""

    camera: CameraModel
    swept_rad: float = 0.03
    """Angle of the camera's rotation during one exposure: one radian per second for 30 ms."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation with streaks."""
        length = max(round(self.swept_rad * self.camera.fx), 1)
        streak = np.full((1, length), 1 / length, np.float32)
        light = cv2.filter2D(_light(seen.rgb), -1, streak, borderType=cv2.BORDER_REPLICATE)
        return _with_light(seen, np.asarray(light, np.float32))


@dataclass(frozen=True, slots=True)
class WrongExposure:
    """Wrong exposure time, as after the step from a corridor to a window."""

    stops: float = 1.5
    """Error in stops, each a factor of two in light, up or down."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation too bright or too dark."""
        return _with_light(seen, _light(seen.rgb) * 2.0 ** float(rng.choice([-self.stops, self.stops])))


@dataclass(frozen=True, slots=True)
class Flare:
    """Flare of a lamp or the sun in the lens: a bright spot, and a veil over the whole image."""

    camera: CameraModel
    spot_rad: float = math.radians(8)
    """Radius of the spot, where its light has fallen to 60 %."""
    spot_light: float = 2.0
    """Light in the middle of the spot; 1 makes a pixel white."""
    veil_light: float = 0.15
    """Light that is added to the whole image."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation with a light somewhere in its upper half."""
        height, width = seen.rgb.shape[:2]
        column = rng.uniform(0, width)
        row = rng.uniform(0, height / 2)
        rows, columns = np.mgrid[:height, :width]
        away_rad = np.hypot((columns - column) / self.camera.fx, (rows - row) / self.camera.fy)
        added = self.veil_light + self.spot_light * np.exp(-0.5 * (away_rad / self.spot_rad) ** 2)
        return _with_light(seen, _light(seen.rgb) + added[..., None].astype(np.float32))


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Noise of a sensor that receives few photons, as in a dark room; it grows with the square root of the light."""

    full_well: float = 400.0
    """Number of photons that make a pixel white; ten thousand in a good image."""
    read_noise: float = 4.0
    """Standard deviation of reading a pixel, in photons."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation with noise."""
        photons = _light(seen.rgb) * self.full_well
        spread = np.sqrt(photons + self.read_noise**2)
        noisy = photons + spread * rng.standard_normal(photons.shape, np.float32)
        return _with_light(seen, noisy / self.full_well)


@dataclass(frozen=True, slots=True)
class WrongWhiteBalance:
    """Wrong white balance between lamp light and daylight: the ratio of red to blue is wrong."""

    gain: float = 1.35
    """Factor by which red grows while blue shrinks, or the reverse; about 1,500 kelvin."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation too warm or too cold."""
        warm = self.gain if rng.random() < 0.5 else 1 / self.gain
        return _with_light(seen, _light(seen.rgb) * np.array([warm, 1.0, 1 / warm], np.float32))


@dataclass(frozen=True, slots=True)
class StrongCompression:
    """JPEG of low quality, as over a poor link."""

    quality: int = 15
    """JPEG quality, from 0 to 100."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation as it is after compression."""
        _, jpeg = cv2.imencode(".jpg", seen.rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, self.quality))
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


@dataclass(frozen=True, slots=True)
class DepthHoles:
    """Holes in depth, as on glass, shiny and black surfaces, and noise elsewhere."""

    share: float = 0.4
    """Share of the pixels in holes."""
    noise_per_m: float = 0.003
    """Standard deviation of depth at 1 m, in metres; it grows with the square of the depth, as in a structured-light
    camera."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation with worse depth; an observation without depth is unchanged."""
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
    """A lens that differs from the calibration: a slightly longer focal length, and uncorrected barrel distortion."""

    camera: CameraModel
    """The camera as calibrated."""
    focal_factor: float = 1.06
    """Ratio of the focal length to that of the calibrated lens."""
    barrel: float = -0.08
    """First radial coefficient of the distortion, k1."""

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


class Perturbation(Protocol):
    """Makes one observation worse."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return a worse observation of the same size; the argument is not changed."""
        ...


_TABLE: Mapping[str, Callable[[CameraModel], Perturbation]] = {
    "blur": MotionBlur,
    "exposure": lambda camera: WrongExposure(),
    "flare": Flare,
    "depth-holes": lambda camera: DepthHoles(),
    "lens": OtherLens,
    "noise": lambda camera: SensorNoise(),
    "white-balance": lambda camera: WrongWhiteBalance(),
    "jpeg": lambda camera: StrongCompression(),
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


def open_perturbation(name: str, camera: CameraModel) -> Perturbation:
    """Return a perturbation of images of a camera; `name` is one of `PERTURBATIONS` but not `DROPPED_FRAMES`."""
    return _TABLE[name](camera)


class PerturbedRobot(RobotView):
    """A robot with perturbations of its camera.

    A lost frame is replaced by the image of the last one that arrived, with the current odometry.
    """

    def __init__(self, robot: Robot, perturbations: Sequence[str], *, seed: int) -> None:
        """Apply all of `perturbations`, names of `PERTURBATIONS`, to each image; `seed` draws their random parts."""
        names = [name for name in perturbations if name != DROPPED_FRAMES]
        super().__init__(robot)
        self._seed = seed
        self._perturbations = [open_perturbation(name, robot.spec.camera) for name in names]
        self._loss = FrameLoss() if DROPPED_FRAMES in perturbations else None
        self._lost = False

    def _changed(self, taken: Observation) -> Observation:
        rng = np.random.default_rng([self._seed, abs(taken.step)])
        last = self._shown
        if self._loss is not None and last is not None:
            self._lost = self._loss.is_lost(rng, was_lost=self._lost)
            if self._lost:
                return replace(taken, rgb=last.rgb, depth=last.depth, original=last.original)
        for perturbation in self._perturbations:
            taken = perturbation(taken, rng)
        return taken
