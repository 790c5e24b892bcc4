"""What goes wrong with a robot's camera: each a function of one observation, with a strength in physical units.

Owns their names and a robot with such a camera. Light is linear in these computations and pictures are not, so pictures
are taken to the power of 2.2 and back; what goes wrong with colours leaves depth as it is.
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
    """The robot turns while the shutter is open: everything becomes a streak along the rows."""

    camera: CameraModel
    swept_rad: float = 0.03
    """Angle that the camera turns by during one exposure: one radian per second for 30 ms."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation with streaks."""
        length = max(round(self.swept_rad * self.camera.fx), 1)
        streak = np.full((1, length), 1 / length, np.float32)
        light = cv2.filter2D(_light(seen.rgb), -1, streak, borderType=cv2.BORDER_REPLICATE)
        return _with_light(seen, np.asarray(light, np.float32))


@dataclass(frozen=True, slots=True)
class WrongExposure:
    """The shutter is open too long or too short, as after the step from a corridor to a window."""

    stops: float = 1.5
    """By so many stops, each a factor of two in light, up or down."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation too bright or too dark."""
        return _with_light(seen, _light(seen.rgb) * 2.0 ** float(rng.choice([-self.stops, self.stops])))


@dataclass(frozen=True, slots=True)
class Flare:
    """A lamp or the sun shines into the lens: a bright spot, and a veil over the whole picture."""

    camera: CameraModel
    spot_rad: float = math.radians(8)
    """Radius of the spot, where its light has fallen to 60 %."""
    spot_light: float = 2.0
    """Light in its middle; 1 is what makes a pixel white."""
    veil_light: float = 0.15
    """Light that is added everywhere."""

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
    """Few photons reach the sensor, as in a dark room: noise that grows with the root of the light."""

    full_well: float = 400.0
    """Photons that make a pixel white; a good picture has ten thousand."""
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
    """The camera takes lamp light for daylight, or the reverse: red and blue are wrong against each other."""

    gain: float = 1.35
    """Red grows by this factor while blue shrinks by it, or the reverse; about 1,500 kelvin."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation too warm or too cold."""
        warm = self.gain if rng.random() < 0.5 else 1 / self.gain
        return _with_light(seen, _light(seen.rgb) * np.array([warm, 1.0, 1 / warm], np.float32))


@dataclass(frozen=True, slots=True)
class StrongCompression:
    """The picture came over a poor link, as a JPEG of low quality."""

    quality: int = 15
    """Of 100."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return the observation as it is after compression."""
        _, jpeg = cv2.imencode(".jpg", seen.rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, self.quality))
        rgb = cv2.imdecode(jpeg, cv2.IMREAD_COLOR_RGB)
        return replace(seen, rgb=np.asarray(rgb, np.uint8), original=None)


def _light(rgb: Rgb) -> NDArray[np.float32]:
    """Return the light (H, W, 3) that made a picture; 1 makes a pixel white."""
    return (rgb.astype(np.float32) / np.float32(255)) ** np.float32(_GAMMA)


def _with_light(seen: Observation, light: NDArray[np.floating]) -> Observation:
    rgb = np.clip(light, 0, 1) ** (1 / _GAMMA) * 255
    return replace(seen, rgb=np.rint(rgb).astype(np.uint8), original=None)


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


DROPPED_FRAMES = "dropped-frames"
"""Not a change of one image, so not in the table: `FrameLoss` draws which frames never arrive."""
ALL = "all"


class Perturbation(Protocol):
    """Makes one observation worse."""

    def __call__(self, seen: Observation, rng: np.random.Generator) -> Observation:
        """Return a worse observation of the same size; the one that comes in stays as it is."""
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
"""All names."""


def chosen_perturbations(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of perturbations, each once; `all` stands for every one.

    Raises OptionError for a name that is none.
    """
    chosen = tuple(dict.fromkeys(names))
    if chosen == (ALL,):
        return PERTURBATIONS
    if unknown := [name for name in chosen if name not in PERTURBATIONS]:
        raise OptionError(
            f"--perturb does not know {', '.join(unknown)}; name one or several of {' '.join(PERTURBATIONS)}, "
            f"separated by spaces, or {ALL}."
        )
    return chosen


def open_perturbation(name: str, camera: CameraModel) -> Perturbation:
    """Return a perturbation of images of a camera; `name` is one of `PERTURBATIONS` but not `DROPPED_FRAMES`."""
    return _TABLE[name](camera)


def perturb_all(observations: Sequence[Observation], perturbation: Perturbation, *, seed: int) -> list[Observation]:
    """Return worse observations; what happens to an image depends on the seed and on its step alone."""
    return [perturbation(seen, np.random.default_rng([seed, abs(seen.step)])) for seen in observations]


class PerturbedRobot(RobotView):
    """Makes worse what a robot sees.

    A frame that is lost leaves the picture of the last one that arrived, with the odometry of now.
    """

    def __init__(self, robot: Robot, perturbations: Sequence[str], *, seed: int) -> None:
        """Look through all of `perturbations` at once, names of `PERTURBATIONS`; `seed` draws what varies."""
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
