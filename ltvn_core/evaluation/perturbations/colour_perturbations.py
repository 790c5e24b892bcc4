"""What goes wrong with a picture's colours: motion blur, exposure, flare, noise, white balance, compression.

Each class is a function of one observation; its fields are the strength. Depth stays as it is. Light is linear in these
computations and pictures are not, so pictures are taken to the power of 2.2 and back.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
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
        column, row = rng.uniform(0, width), rng.uniform(0, height / 2)
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
