"""Chooses the topics of a drive in a bag: images of one camera, depth, and odometry, by type, name and content.

Owns the choice and the messages about it.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import takewhile

from ltvn_core.data.importing.raw_frame import NOTHING, ReadOptions
from ltvn_core.data.importing.rosbag.bag_files import BagFiles
from ltvn_core.data.importing.rosbag.bag_survey import ODOMETRY, PATH, POSES, BagSurvey
from ltvn_core.data.importing.rosbag.message_forms import POSE_IN_FRAME
from ltvn_core.data.importing.rosbag.path_poses import has_own_stamps
from ltvn_core.data.importing.rosbag.video_stream import is_depth_video, is_video
from ltvn_core.errors import DriveError
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE, has_sixteen_bits, shows_depth

FROM_TREE = "tf"
"""Value of `--odometry` that takes the odometry from the transform tree."""

_SUFFIXES = re.compile(r"/(compressed|compressedDepth|ffmpeg|foxglove)$")
_TRUTH = re.compile(r"(^|[/_])(ground_?truth|gt|mocap|vicon|optitrack|qualisys)([/_]|$)", re.IGNORECASE)
_DEPTH = re.compile(r"depth", re.IGNORECASE)
_COLOURS_BY_DEPTH = re.compile(r"(colou?r|rgb)\w*_to_depth|depth_?cam", re.IGNORECASE)
"""Names of colour topics in the view of the depth camera, and of cameras that deliver both colours and depth."""
_NO_CAMERA = re.compile(
    r"infra|(^|[/_])ir\d?([/_]|$)|thermal|debug|annotat|overlay|detect|result|segment|mask|costmap|disparity",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenTopics:
    """The topics that make up a drive."""

    rgb: str
    depth: str | None
    odometry: str | None
    """Topic of the odometry; None if odometry comes from the transform tree, or if there is none."""
    truth: str | None
    camera_info: str | None
    depth_info: str | None
    unused_depths: tuple[str, ...] = ()
    """Topics that could be depth, but are not used."""
    lost_depths: tuple[str, ...] = ()
    """Topics that are called depth but do not hold it; only given if no other depth topic exists."""
    depth_videos: tuple[str, ...] = ()
    """Topics with depth as video, which is not supported; only given if no other depth topic exists."""

    unused_poses: tuple[str, ...] = ()
    """Topics that could be odometry, but are not used."""

    def roles(self) -> dict[str, str]:
        """Return the role of each topic in use."""
        pairs = {
            self.rgb: "rgb",
            self.depth: "depth",
            self.odometry: "odometry",
            self.truth: "truth",
            self.camera_info: "camera_info",
            self.depth_info: "camera_info",
        }
        return {topic: role for topic, role in pairs.items() if topic is not None}

    def moments(self) -> tuple[str, ...]:
        """Return the topics whose stamps are compared with each other."""
        return tuple(topic for topic in (self.rgb, self.depth, self.odometry, self.truth) if topic is not None)


def choose_topics(files: BagFiles, found: BagSurvey, options: ReadOptions) -> ChosenTopics:
    """Return the topics of the drive. Raises DriveError with a list of topics if none or several fit."""
    images = _named(files, IMAGE, COMPRESSED_IMAGE)
    forms = {name: _format(name, found) for name in images}
    depth_videos = tuple(
        name for name, form in forms.items() if is_depth_video(form) or (is_video(form) and _is_called_depth(name))
    )
    if options.depth is not None and options.depth.lstrip("/") in [name.lstrip("/") for name in depth_videos]:
        raise DriveError(f"{files.path}: {video_depth_text(options.depth)} `--depth none` omits depth.")
    images = [name for name in images if name not in depth_videos]
    depths = [name for name in images if _is_depth(name, found)]
    depth = None if options.depth == NOTHING else _asked(files, options.depth, "--depth", images)
    rgb = _asked(files, options.rgb, "--rgb", images) or _colour(images, {*depths, depth}, found, files)
    if depth is None and options.depth != NOTHING:

        def rank(name: str) -> tuple[bool, bool, int, int, str]:
            pairs = zip(name.split("/"), rgb.split("/"), strict=False)
            shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
            registered = re.search(r"aligned|registered", name) is not None
            return bool(_NO_CAMERA.search(name)), not registered, -shared, len(name), name

        depth = min((name for name in depths if name != rgb), key=rank, default=None)
    infos = _named(files, CAMERA_INFO)
    odometry, truth = _poses(files, found, options)
    unused = [name for name in images if depth is None and name != rgb]
    possible = tuple(name for name in unused if _could_be_depth(name, found))
    lost = tuple(name for name in unused if _is_called_depth(name) and name not in possible)
    return ChosenTopics(
        rgb=rgb,
        depth=depth,
        odometry=odometry,
        truth=truth,
        camera_info=_asked(files, options.camera_info, "--camera-info", infos) or _info_beside(rgb, infos, images),
        depth_info=None if depth is None else _info_beside(depth, infos, images),
        unused_depths=possible,
        lost_depths=() if possible or options.depth == NOTHING else lost,
        unused_poses=tuple(
            name
            for name in [*_named(files, *POSES), *_named(files, PATH)]
            if name not in (odometry, truth) and has_own_stamps(found.samples.get(name))
        ),
        depth_videos=() if depth is not None or options.depth == NOTHING else depth_videos,
    )


def video_depth_text(topic: str) -> str:
    """Return a note about a topic with depth as video."""
    return (
        f"{topic} is depth as a video, which is not supported, so it is not used. Record the depth images as they are "
        "(16UC1 or 32FC1), or convert them with `ros2 run image_transport republish`."
    )


def _named(files: BagFiles, *msgtypes: str) -> list[str]:
    return sorted(topic.name for topic in files.topics.values() if topic.count and topic.msgtype in msgtypes)


def _is_depth(name: str, found: BagSurvey) -> bool:
    """Tell whether a topic is depth: its images have a depth encoding, or 16 bits and a name that means depth."""
    sample = found.samples.get(name)
    if sample is None:
        return _is_called_depth(name)
    return shows_depth(sample) or (_is_called_depth(name) and has_sixteen_bits(sample))


def _could_be_depth(name: str, found: BagSurvey) -> bool:
    sample = found.samples.get(name)
    return _is_depth(name, found) or (sample is not None and has_sixteen_bits(sample))


def _format(name: str, found: BagSurvey) -> str:
    return str(getattr(found.samples.get(name), "format", ""))


def _is_called_depth(name: str) -> bool:
    return _DEPTH.search(name) is not None and _COLOURS_BY_DEPTH.search(name) is None


def _asked(files: BagFiles, name: str | None, option: str, candidates: Sequence[str]) -> str | None:
    if name is None or name in (FROM_TREE, NOTHING):
        return None
    for candidate in (name, "/" + name):
        if candidate in candidates:
            return candidate
    other = files.topics.get(name) or files.topics.get("/" + name)
    found = f"has no topic {name}" if other is None else f"has {name} as {other.written.schema}, which does not do"
    raise DriveError(f"{files.path} {found} for {option}; it may be {_listed(candidates)}.")


def _colour(images: Sequence[str], depths: Collection[str | None], found: BagSurvey, files: BagFiles) -> str:
    colours = [name for name in images if name not in depths]
    if not colours:
        kinds = sorted({topic.written.schema for topic in files.topics.values()})
        foreign = [f"{name} ({encoding})" for name, encoding in files.foreign.items()]
        left_out = f"; left out because of their encoding or schema: {_listed(foreign)}" if foreign else ""
        raise DriveError(
            f"{files.path} has no colour images: expected a topic of type {IMAGE} or {COMPRESSED_IMAGE}, or of "
            f"Foxglove's images or videos, found {_listed(kinds)}{left_out}."
        )
    best = min(map(_colour_rank, colours))
    equal = [name for name in colours if _colour_rank(name) == best]
    if len({_camera_of(name) for name in equal}) > 1:
        possible = [name for name in equal if _could_be_depth(name, found)]
        hint = f"; topics with 16 bits, which may be depth for --depth: {_listed(possible)}" if possible else ""
        raise DriveError(f"{files.path} has several cameras; choose one with --rgb: {_listed(equal)}{hint}.")
    # Among topics of one camera: images before video, which loses more, rectified before raw, and the shortest name,
    # which belongs to the uncompressed images.
    return min(equal, key=lambda name: (is_video(_format(name, found)), "rect" not in name, len(name), name))


def _colour_rank(name: str) -> int:
    words = set(re.split(r"[/_]", name.lower()))
    rank = 20 if _NO_CAMERA.search(name) or _is_called_depth(name) else 0
    rank += 4 * bool(words & {"rear", "back", "side", "right", "down", "up"}) + 2 * ("left" in words)
    return rank - 2 * bool(words & {"front", "forward"}) - bool(words & {"color", "colour", "rgb"})


def _camera_of(name: str) -> str:
    """Return the namespace of a camera: the topic's name without its last part."""
    return _SUFFIXES.sub("", name).rpartition("/")[0]


def _info_beside(image: str, infos: Sequence[str], images: Collection[str]) -> str | None:
    """Return the CameraInfo in the namespace of an image topic, or in the nearest enclosing namespace.

    In each namespace, `camera_info` is preferred; otherwise the only other CameraInfo there or one level below is used.
    One level below, a CameraInfo with images beside it does not count, because it describes their camera.
    """
    namespace = _camera_of(image)
    while True:
        if f"{namespace}/camera_info" in infos:
            return f"{namespace}/camera_info"
        for place in ([_camera_of(info) for info in infos], [_around(info, images) for info in infos]):
            near = [info for info, where in zip(infos, place, strict=True) if where == namespace and namespace]
            if len(near) == 1:
                return near[0]
        if not namespace:
            return infos[0] if len(infos) == 1 else None
        namespace = namespace.rpartition("/")[0]


def _around(info: str, images: Collection[str]) -> str | None:
    """Return the namespace that encloses that of a CameraInfo; None if there are images in its own namespace."""
    own = _camera_of(info)
    return None if any(name.startswith(f"{own}/") for name in images) else own.rpartition("/")[0]


def _poses(files: BagFiles, found: BagSurvey, options: ReadOptions) -> tuple[str | None, str | None]:
    """Return the topics of odometry and of ground truth."""
    poses = _named(files, *POSES)
    paths = _named(files, PATH)
    truths = [name for name in poses if _TRUTH.search(name) and name != options.odometry]
    truth = truths[0] if truths else None
    if options.odometry in (FROM_TREE, NOTHING):
        return None, truth
    if (asked := _asked(files, options.odometry, "--odometry", [*poses, *paths, FROM_TREE, NOTHING])) is not None:
        return asked, truth
    candidates = [name for name in _named(files, ODOMETRY) if name not in truths]
    if not candidates and not found.tree.motions:  # Foxglove has no odometry type, only poses.
        candidates = [name for name in poses if files.topics[name].written.foxglove == POSE_IN_FRAME]
        candidates = [name for name in candidates if name not in truths]
    best = [name for name in candidates if name.endswith("/odom")] or candidates
    if len(best) > 1:
        raise DriveError(f"{files.path} has several odometry topics; choose one with --odometry: {_listed(best)}.")
    return (best[0] if best else None), truth


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "") or "nothing"
