"""Pictures inside a tool's lines: an image of the run as a data URL, with something drawn into it, and small curves.

Owns the pixels. What is drawn where comes from `ltvn_core.analysis`.
"""

import base64
from collections.abc import Sequence
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
_CURVE_PX = (340, 90)


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


def step_curve_svg(
    points: Sequence[tuple[float, float]], *, lines: Sequence[tuple[float, str]] = (), colour: Rgb8
) -> str:
    """Return steps through points (x, y) with y in [0, 1], and named horizontal lines, as a small SVG."""
    if not points:
        return ""
    width, height = _CURVE_PX
    first, last = points[0][0], max(points[-1][0], points[0][0] + 1e-9)

    def place(x: float, y: float) -> tuple[float, float]:
        return (x - first) / (last - first) * (width - 8) + 4, (1 - y) * (height - 8) + 4

    path, before = "", None
    for x, y in points:
        u, v = place(x, y)
        path += f"M{u:.1f} {v:.1f}" if before is None else f"L{u:.1f} {before:.1f}L{u:.1f} {v:.1f}"
        before = v
    path += f"L{width - 4} {before:.1f}"
    rules = "".join(
        f'<line x1="4" x2="{width - 4}" y1="{place(first, y)[1]:.1f}" y2="{place(first, y)[1]:.1f}" stroke="#868e96" '
        f'stroke-dasharray="4 3"/><text x="6" y="{place(first, y)[1] - 3:.1f}" font-size="10" fill="#a6a7ab">'
        f"{escape(name)}</text>"
        for y, name in lines
    )
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" class="lt-curve">{rules}'
        f'<path d="{path}" fill="none" stroke="{colour.css}" stroke-width="2"/></svg>'
    )


def legend_item(colour: Rgb8, words: str) -> str:
    """Return a dot of a colour and what it means."""
    dot = f'<span style="color:{colour.css}">●</span>'
    return f'<span style="white-space:nowrap;margin-right:.8em">{dot} {escape(words)}</span>'


def calibration_svg(cells: Sequence[tuple[float, float, int]], colour: Rgb8) -> str:
    """Return what was foretold against what is true, both in [0, 1], as dots as large as their counts; a small SVG."""
    side, margin = 150, 12
    most = max((count for *_, count in cells), default=1)

    def place(share: float) -> float:
        return margin + share * (side - 2 * margin)

    dots = "".join(
        f'<circle cx="{place(said):.1f}" cy="{side - place(true):.1f}" r="{2 + 5 * (count / most) ** 0.5:.1f}" '
        f'fill="{colour.css}"><title>p {said:.2f}, true {true:.2f}, {count} edges</title></circle>'
        for said, true, count in cells
    )
    return (
        f'<svg viewBox="0 0 {side} {side}" role="img" width="{side}" height="{side}">'
        f'<path d="M{margin} {side - margin}L{side - margin} {margin}" stroke="#868e96" stroke-dasharray="4 3"/>'
        f'<path d="M{margin} {margin}V{side - margin}H{side - margin}" fill="none" stroke="#868e96"/>'
        f'<text x="{margin + 3}" y="{margin + 4}" font-size="10" fill="#a6a7ab">true</text>'
        f'<text x="{side - margin}" y="{side - margin + 10}" font-size="10" text-anchor="end" fill="#a6a7ab">p</text>'
        f"{dots}</svg>"
    )


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
