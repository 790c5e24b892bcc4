"""Pictures inside a tool's lines: an image of the run as a data URL, with something drawn into it; charts are `charts`.

Owns the pixels. What is drawn where comes from `ltvn_core.analysis`.
"""

import base64
from dataclasses import replace
from html import escape

import cv2
import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.waypoint_projection import pole_in_image
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.palette import Rgb8
from ltvn_core.types import Observation, Rgb, Waypoint

_PICTURE_PX = 288
"""Width of an image in an answer."""


def image_figure(seen: Observation | None, caption: str, camera: CameraModel, waypoint: Waypoint | None = None) -> str:
    """Return a figure of an image of `camera`, with a waypoint (3,) drawn into it; a grey one if there is no image."""
    if seen is None:
        return f'<figure><div class="lt-none">no image</div><figcaption>{escape(caption)}</figcaption></figure>'
    scale = _PICTURE_PX / seen.rgb.shape[1]
    way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
    rgb = np.asarray(cv2.resize(seen.rgb, None, fx=scale, fy=scale, interpolation=way), np.uint8)
    if waypoint is not None:
        tilted = camera if seen.tilt is None else replace(camera, **seen.tilt._asdict())
        _draw_pole(rgb, waypoint, tilted, scale)
    picture = f'<img src="{_data_url(rgb)}" alt="{escape(caption)}">'
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"


def legend_item(colour: Rgb8, words: str) -> str:
    """Return a dot of a colour and what it means."""
    dot = f'<span style="color:{colour.css}">●</span>'
    return f'<span style="white-space:nowrap;margin-right:.8em">{dot} {escape(words)}</span>'


def _draw_pole(rgb: Rgb, waypoint: Waypoint, camera: CameraModel, scale: float) -> None:
    pole = pole_in_image(waypoint, camera)
    if pole is None:
        return
    top, foot = (tuple(round(scale * value) for value in end) for end in pole)
    colour = tuple(int(part) for part in palette.TARGET)
    cv2.line(rgb, top, foot, colour, 2, cv2.LINE_AA)
    cv2.circle(rgb, foot, 5, colour, -1, cv2.LINE_AA)


def _data_url(rgb: Rgb) -> str:
    found, coded = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 85])
    assert found
    return "data:image/jpeg;base64," + base64.b64encode(coded.tobytes()).decode("ascii")
