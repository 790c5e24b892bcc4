"""Converts matched image messages to a raw frame: decodes images, finds the lenses, aligns depth with the colours.

Owns the cameras of a bag's images, and the alignment of depth with the colour camera. Also owns the doubt whether a
CameraInfo describes the images beside it, because simulators and drivers may send default values. `image_matching`
decides which messages belong together.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.raw_frame import FrameMoment, RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag.bag_survey import frame_name
from ltvn_core.data.importing.rosbag.bag_topics import ChosenTopics
from ltvn_core.data.importing.rosbag.camera_rig import CameraRig
from ltvn_core.data.importing.rosbag.image_matching import MatchedImages, PendingImage
from ltvn_core.data.importing.rosbag.transform_tree import TransformTree
from ltvn_core.data.importing.rosbag.video_stream import VideoPicture
from ltvn_core.data.importing.source_camera import fitted
from ltvn_core.data.importing.spatial_pose import Transform
from ltvn_core.errors import DriveError
from ltvn_core.robots.ros2.ros_cameras import is_calibrated, ros_camera
from ltvn_core.robots.ros2.ros_images import decode_colours, decode_metres, has_metres
from ltvn_core.types import Depth, Rgb

_NEAREST_M = 0.01
"""Least valid depth, in metres."""
_OFF_CENTRE = 0.2
"""Largest distance of the principal point from the middle of the image, as a share of the image's size."""
_ADVICE = (
    "Give the lens with --camera fx,fy,cx,cy,width,height in pixels; a simulator's, without distortion, has fx = fy = "
    "width / 2 / tan(horizontal field of view / 2) and its centre in the middle."
)
_SAME_LENS = 0.015
"""Largest difference of focal lengths and principal points of two lenses that count as the same, as a share of the
width."""


def register_depth(
    depth_m: Depth, depth_camera: CameraModel, colour_camera: CameraModel, colour_from_depth: Transform
) -> Depth:
    """Return the depth that the colour camera would have measured, 0 where there is none.

    The result covers the view of the colours, with at most as many pixels as the depth, so that neighbouring points
    leave no gaps. If several points fall into a pixel, the nearest counts.

    Args:
        depth_m: (h, w) metres along the depth camera's axis.
        depth_camera: The lens and size of `depth_m`.
        colour_camera: The lens and size of the colours.
        colour_from_depth: (4, 4), takes points of the depth camera's optical frame to the colour camera's.
    """
    scale = min(1.0, depth_camera.fx / colour_camera.fx, depth_camera.fy / colour_camera.fy)
    target = colour_camera.scaled(
        max(round(colour_camera.width * scale), 1), max(round(colour_camera.height * scale), 1)
    )
    rows, columns = np.nonzero(depth_m > 0)
    metres = depth_m[rows, columns].astype(np.float64)
    rays = _rays(depth_camera)[rows, columns]
    points = np.column_stack([rays * metres[:, None], metres]) @ colour_from_depth[:3, :3].T + colour_from_depth[:3, 3]
    points = points[points[:, 2] > _NEAREST_M]
    pixels = target.rays_to_pixels(points[:, :2] / points[:, 2:])
    known = np.isfinite(pixels).all(axis=1)
    column, row = np.rint(pixels[known].clip(-1, 2**20)).astype(np.int64).T
    inside = (column >= 0) & (column < target.width) & (row >= 0) & (row < target.height)
    nearest = np.full(target.width * target.height, np.inf)
    np.minimum.at(nearest, row[inside] * target.width + column[inside], points[known][inside, 2])
    return np.where(np.isfinite(nearest), nearest, 0).astype(np.float32).reshape(target.height, target.width)


@lru_cache(maxsize=4)
def _rays(camera: CameraModel) -> NDArray[np.float64]:
    """Return the rays of all pixels (h, w, 2): right and down at one metre of depth."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return camera.pixels_to_rays(np.stack([columns, rows], axis=-1).astype(np.float64))


def lens_doubt(lens: CameraModel, info: Any, topic: str) -> str | None:
    """Return the reason for doubting a lens; None if there is none.

    Args:
        lens: The lens at the size of the images, after cropping and binning.
        info: The CameraInfo with this lens.
        topic: Topic of the CameraInfo.
    """
    middle_x = (lens.width - 1) / 2
    middle_y = (lens.height - 1) / 2
    if abs(lens.cx - middle_x) > _OFF_CENTRE * lens.width or abs(lens.cy - middle_y) > _OFF_CENTRE * lens.height:
        return (
            f"{topic} puts the centre of the lens at {lens.cx:.0f}, {lens.cy:.0f} in images of {lens.width} x "
            f"{lens.height} pixels, far from their middle, so it is probably not the lens of these images, and "
            f"distances and directions will be wrong. {_ADVICE}"
        )
    said = (int(getattr(info, "width", 0)), int(getattr(info, "height", 0)))
    if 0 < said[0] < lens.width and 0 < said[1] < lens.height:
        return (
            f"{topic} describes images of {said[0]} x {said[1]} pixels, but they have {lens.width} x {lens.height}, "
            f"which is larger; the lens was scaled to them, which is wrong if it belongs to another camera. {_ADVICE}"
        )
    return None


class FrameDecoder:
    """Decodes the images of one colour camera and of the depth beside it."""

    def __init__(
        self,
        topics: ChosenTopics,
        samples: Mapping[str, Any],
        tree: TransformTree,
        rig: CameraRig,
        *,
        options: ReadOptions,
        doubt: Callable[[str], None],
    ) -> None:
        """Start with the survey of the bag; `samples` grows while the bag is streamed.

        Args:
            topics: The topics in use.
            samples: The first message of each topic.
            tree: Transform tree with the frames of colours and depth.
            rig: Mounting and motion of the camera.
            options: The user's camera and unit of depth, which override those of the bag.
            doubt: Called with each doubt.
        """
        self._topics = topics
        self._samples = samples
        self._tree = tree
        self._rig = rig
        self._asked = options.camera
        self._depth_unit_m = options.depth_unit_m
        self._doubt = doubt
        self._lenses: dict[tuple[str, int, int], CameraModel | None] = {}

    def decode(self, matched: MatchedImages, moment: FrameMoment) -> RawFrame:
        """Return the frame of a moment. Raises DriveError where an image is damaged or no camera fits it."""
        name = f"{self._topics.rgb} at {moment.stamp:.3f}"
        image = matched.colours.message
        rgb = image.colours() if isinstance(image, VideoPicture) else decode_colours(image, name)
        lens = self._colour_lens(rgb, name)
        depth = None
        depth_lens = None
        if matched.depth is not None:
            depth, depth_lens = self._depth(matched.depth, lens, frame_name(image.header.frame_id))
        return RawFrame(
            stamp=moment.stamp,
            rgb=rgb,
            depth_m=depth,
            camera=None if lens is None else self._rig.mounting.mounted(lens),
            depth_camera=depth_lens,
            odometry=moment.odometry,
            truth=moment.truth,
            tilt=moment.tilt,
            name=name,
        )

    def _colour_lens(self, rgb: Rgb, name: str) -> CameraModel | None:
        height, width = rgb.shape[:2]
        if self._asked is not None:
            return fitted(self._asked, width, height, name)
        lens = self._lens(self._topics.rgb, self._topics.camera_info, width, height)
        if lens is not None and (doubt := self._lens_doubt(lens, self._topics.camera_info)) is not None:
            self._doubt(doubt)
        return lens

    def _lens(self, image_topic: str, info_topic: str | None, width: int, height: int) -> CameraModel | None:
        """Return the lens of images with this size, without mounting; None if the bag does not contain it. Raises
        DriveError."""
        key = (image_topic, width, height)
        if self._lenses.get(key) is None:
            info = self._samples.get(info_topic or "")
            is_rectified = "rect" in image_topic.lower()
            self._lenses[key] = (
                ros_camera(info, width, height, rectified=is_rectified, topic=str(info_topic))
                if info is not None and is_calibrated(info)
                else None
            )
        return self._lenses[key]

    def _lens_doubt(self, lens: CameraModel, info_topic: str | None) -> str | None:
        return lens_doubt(lens, self._samples.get(info_topic or ""), str(info_topic))

    def _depth_lens(self, topic: str, width: int, height: int) -> CameraModel | None:
        """Return the lens of depth images; None if the bag has none, or an impossible one."""
        info_topic = self._topics.depth_info
        try:
            lens = self._lens(topic, info_topic, width, height)
        except DriveError as error:
            self._doubt(f"The lens of the depth images is unknown, so that of the colours is used: {error}")
            return None
        if lens is None or self._lens_doubt(lens, info_topic) is not None or self._shares_corrected_lens(lens):
            return None
        return lens

    def _shares_corrected_lens(self, depth: CameraModel) -> bool:
        """Tell whether the user replaced the lens of the colours, and the bag gives that same lens for depth."""
        if self._asked is None:
            return False
        try:
            said = self._lens(self._topics.rgb, self._topics.camera_info, self._asked.width, self._asked.height)
        except DriveError:
            return False
        return said is not None and _are_one(said, depth)

    def _depth(
        self, image: PendingImage, colours: CameraModel | None, colours_frame: str
    ) -> tuple[Depth, CameraModel | None]:
        """Return depth aligned with the colours; or unchanged, with its own lens if that differs."""
        topic = str(self._topics.depth)
        name, unit_m = f"{topic} at {image.stamp:.3f}", self._depth_unit_m
        if unit_m is not None and has_metres(image.message):
            depth = decode_metres(image.message, name) * np.float32(unit_m)
        else:
            depth = decode_metres(image.message, name) if unit_m is None else decode_metres(image.message, name, unit_m)
        lens = self._depth_lens(topic, depth.shape[1], depth.shape[0])
        own_lens = None if lens is None or colours is None or _are_one(colours, lens) else lens
        depth_frame = frame_name(image.message.header.frame_id)
        if depth_frame == colours_frame:
            return depth, own_lens
        apart = self._tree.lookup(colours_frame, depth_frame, image.stamp)
        if apart is None or lens is None or colours is None:
            self._doubt(
                f"Depth is of the frame {depth_frame or 'without a name'} and colours are of "
                f"{colours_frame or 'one without a name'}, and the bag has no transform between them, so they are "
                "assumed to be the same. Record /tf_static and both camera_info, or registered depth."
            )
            return depth, own_lens
        # From the pose between two image frames to the pose between their optical frames.
        turn = np.eye(4)
        turn[:3, :3] = self._rig.image_turn
        return register_depth(depth, lens, colours, turn.T @ apart @ turn), None


def _are_one(colours: CameraModel, depth: CameraModel) -> bool:
    scaled = colours.scaled(depth.width, depth.height)
    mine, other = (np.array([lens.fx, lens.fy, lens.cx, lens.cy]) for lens in (scaled, depth))
    return bool(np.abs(mine - other).max() < _SAME_LENS * depth.width)
