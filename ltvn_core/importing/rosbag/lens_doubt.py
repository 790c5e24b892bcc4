"""Whether a CameraInfo can describe the images beside it: simulators and drivers send defaults that do not."""

from typing import Any

from ltvn_core.cameras.camera_model import CameraModel

_OFF_CENTRE = 0.2
"""No lens has its centre so far from the middle of the image, as a share of the image's size."""
_ADVICE = (
    "Give the lens by --camera fx,fy,cx,cy,width,height in pixels; a simulator's, without distortion, has fx = fy = "
    "width / 2 / tan(horizontal field of view / 2) and its centre in the middle."
)


def lens_doubt(lens: CameraModel, info: Any, topic: str) -> str | None:
    """Return what speaks against a lens; None where nothing does.

    Args:
        lens: The lens at the size of the images, after cropping and binning.
        info: The CameraInfo that says so.
        topic: Where it came from.
    """
    middle_x, middle_y = (lens.width - 1) / 2, (lens.height - 1) / 2
    if abs(lens.cx - middle_x) > _OFF_CENTRE * lens.width or abs(lens.cy - middle_y) > _OFF_CENTRE * lens.height:
        return (
            f"{topic} puts the centre of the lens at {lens.cx:.0f}, {lens.cy:.0f} in images of {lens.width} x "
            f"{lens.height} pixels, far from their middle, so it is hardly the lens of these images, and distances "
            f"and directions are wrong. {_ADVICE}"
        )
    said = (int(getattr(info, "width", 0)), int(getattr(info, "height", 0)))
    if 0 < said[0] < lens.width and 0 < said[1] < lens.height:
        return (
            f"{topic} is of images of {said[0]} x {said[1]} pixels, but they have {lens.width} x {lens.height}, which "
            f"is more than the camera takes; its lens was scaled to them, which is wrong where it is of another "
            f"camera. {_ADVICE}"
        )
    return None
