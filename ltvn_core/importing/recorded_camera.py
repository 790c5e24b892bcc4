"""The camera of an imported recording: the source's own lens, upright, and at most 320 x 240 pixels.

Its distortion stays, because an image without is stretched at the rim and cut off, and key points are found best in
what the lens saw; who measures asks the camera for rays. Owns the choice of that camera.
`ltvn_core.cameras.rectification` makes its images.
"""

from dataclasses import replace

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.preprocessing import ORIGINAL_SIZE


def recorded_camera(source: CameraModel) -> CameraModel:
    """Return the camera to whose images those of `source` are turned; pitch and height stay, roll is undone."""
    upright = _upright(source)
    long_side, short_side = max(upright.width, upright.height), min(upright.width, upright.height)
    scale = min(1.0, ORIGINAL_SIZE.long_side / long_side, ORIGINAL_SIZE.short_side / short_side)
    if scale == 1.0:
        return upright
    return upright.scaled(max(round(upright.width * scale), 1), max(round(upright.height * scale), 1))


def _upright(source: CameraModel) -> CameraModel:
    """Return a camera as if it were mounted without quarter turns and roll."""
    width, height = source.width, source.height
    places = {
        0: (source.cx, source.cy),
        1: (source.cy, width - 1 - source.cx),
        2: (width - 1 - source.cx, height - 1 - source.cy),
        3: (height - 1 - source.cy, source.cx),
    }
    cx, cy = places[source.quarter_turns]
    level = replace(
        source,
        cx=cx,
        cy=cy,
        distortion=source.distortion if source.fisheye else _turned(source.distortion, source.quarter_turns),
        quarter_turns=0,
        roll_rad=0.0,
        depth_scale=1.0,
    )
    if source.quarter_turns % 2 == 0:
        return level
    return replace(level, width=height, height=width, fx=source.fy, fy=source.fx)


def _turned(distortion: tuple[float, ...], quarter_turns: int) -> tuple[float, ...]:
    """Return coefficients for the turned picture: p1 and p2 of k1 k2 p1 p2 ... are a direction and turn with it."""
    if not distortion:
        return distortion
    down, right = distortion[2:4]
    for _ in range(quarter_turns):
        right, down = down, -right
    return (*distortion[:2], down, right, *distortion[4:])
