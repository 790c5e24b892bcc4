"""Reads a ROS bag as a drive: one frame after the other, each with colours, depth and pose of the same moment.

Owns the conversion of messages to raw frames. After a survey of its beginning, the bag is streamed once, whatever its
size.
"""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.data.importing.pose_outages import LOST, NOT_FINITE, NULL, PoseOutages
from ltvn_core.data.importing.raw_frame import (
    NO_DEPTH,
    NO_POSE,
    NOT_LATER,
    NOTHING,
    DriveFacts,
    FrameFilter,
    FrameMoment,
    RawFrame,
    ReadOptions,
    SourceFact,
)
from ltvn_core.data.importing.rosbag.bag_files import BagFiles, RawMessage
from ltvn_core.data.importing.rosbag.bag_survey import (
    PATH,
    TRANSFORMS,
    BagSurvey,
    add_transforms,
    are_all_lost,
    frame_name,
    is_lost,
    is_static,
    ros_pose,
    stamp_s,
    survey,
    survey_frames,
)
from ltvn_core.data.importing.rosbag.bag_topics import choose_topics, video_depth_text
from ltvn_core.data.importing.rosbag.camera_rig import (
    CameraRig,
    FrameEdge,
    find_rig,
    robot_frame,
    upright,
    upright_name,
)
from ltvn_core.data.importing.rosbag.frame_decoder import FrameDecoder
from ltvn_core.data.importing.rosbag.image_matching import MatchedImages, PendingImage, StampMatcher
from ltvn_core.data.importing.rosbag.path_poses import path_poses
from ltvn_core.data.importing.rosbag.transform_tree import MovingFrame
from ltvn_core.data.importing.rosbag.video_stream import DAMAGED, VideoStream, is_video
from ltvn_core.data.importing.spatial_pose import Transform, spatial_pose, transform
from ltvn_core.errors import DriveError
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO

_CLOCKS_APART_S = 5.0
"""Time difference between the stamps of messages recorded together, in seconds, above which they come from different
clocks."""
_SURELY_APART_S = 1.0
_PERHAPS_APART_S = 0.3
_AHEAD_S = 0.2
"""The same where the times of recording are steady: above the first they come from different clocks, above the second
only if one of them is this far in the future, because messages may be late on their way."""
_CLOCK_BEGINS_S = 60.0
"""First stamp in seconds below which the clock started at 0 with the recording, as a simulator's clock does."""
_TOLERANCES_S = (0.01, 0.1)
"""Smallest and largest tolerance in seconds for matching colours and depth; within these limits it is half a frame."""
_MOST_DOUBTS = 10
_PATH_AHEAD_S = 5.0
"""Time in seconds by which the poses of a path are taken ahead of the images; the tree keeps only the last ones."""


class BagDrive:
    """A bag that is open for reading; a `DriveReader`."""

    def __init__(self, path: Path, paths: Sequence[Path], options: ReadOptions) -> None:
        """Survey the bag at `path` with the files `paths`, and choose its topics. Raises DriveError."""
        self._files = BagFiles(path, paths)
        found = survey(self._files)
        self._topics = choose_topics(self._files, found, options)
        self._samples = found.samples
        self._tree = found.tree
        self._truth = MovingFrame()
        self._path: deque[tuple[float, Transform]] = deque()
        self.dropped: Counter[str] = Counter()
        """Number of images that were left out, by reason."""
        self.doubts: list[str] = []
        """Doubts about the bag, as sentences."""
        self._transforms = [name for name, topic in self._files.topics.items() if topic.msgtype in TRANSFORMS]
        odometry = self._topics.odometry or ""
        self._by_log = self._lacks_stamps(found) or self._has_clocks_apart(found)
        self._path_lag_s = (found.lead_s(odometry) or 0.0) if self._by_log else 0.0
        self._is_zero_a_time = any(stamp < _CLOCK_BEGINS_S for stamp in found.earliest_s.values())
        self._body = np.eye(4)
        """Rotation from the robot's frame to the frame that odometry names; a turn if that is base_link_frd."""
        self._edge = self._odometry_frames(options)
        # If all poses are unknown by their covariance, it means nothing.
        self._says_loss = not (found.lost.get(odometry) and are_all_lost(self._files, odometry))
        if not self._says_loss:
            self._doubt(
                f"By the covariance of {odometry} none of its poses is known (9999 or more, or negative); they are "
                "used all the same. Make the robot's driver write how sure it is."
            )
        self._outages = PoseOutages(odometry or " and ".join(self._transforms))
        self._rig = self._find_rig()
        self._decoder = FrameDecoder(
            self._topics, self._samples, self._tree, self._rig, options=options, doubt=self._doubt
        )
        self._last_stamp = float("-inf")
        self._video = self._video_of(self._samples.get(self._topics.rgb))
        self._doubt_files()

    @property
    def facts(self) -> DriveFacts:
        """Return the facts of the drive."""
        chosen = self._topics
        roles = chosen.roles()
        if self._rig.world and chosen.odometry is None:
            roles |= dict.fromkeys(self._transforms, "odometry")
        possible = {name: "camera_info" for name, topic in self._files.topics.items() if topic.msgtype == CAMERA_INFO}
        possible |= dict.fromkeys(chosen.unused_poses, "odometry") | dict.fromkeys(chosen.unused_depths, "depth")
        seconds = self._files.duration_s
        streams = [
            SourceFact(
                role=roles.get(topic.name, ""),
                name=topic.name,
                count=topic.count,
                rate_hz=topic.count / seconds if seconds > 0 else None,
                could_be=possible.get(topic.name, ""),
                kind="" if topic.name in roles else topic.written.schema,
            )
            for topic in self._files.topics.values()
        ]
        return DriveFacts(
            format="rosbag",
            frames=self._files.topics[chosen.rgb].count,
            streams=streams,
            place=self._files.path.resolve().stem,
            odometry_frame=upright_name(self._rig.world) or self._rig.world,
        )

    def _doubt_files(self) -> None:
        """Tell what in the files and among the topics is not read."""
        files = self._files
        if files.foreign:
            said = ", ".join(f"{name} ({encoding})" for name, encoding in [*files.foreign.items()][:_MOST_DOUBTS])
            self._doubt(f"Topics in unsupported encodings or schemas are left out: {said}.")
        if files.unfinished:
            self._doubt(
                f"The recorder of {', '.join(files.unfinished)} was ended before it had finished, so the end of the "
                "drive may be missing. Its last messages lie in a file beside it and were read too; keep both together."
            )
        for name in self._topics.lost_depths:
            self._doubt(
                f"{name} is called depth, but its images have only 8 bits, so it is not used. "
                "Record the depth images as they are (16UC1 or 32FC1), or the topic that ends in /compressedDepth."
            )
        for name in self._topics.depth_videos:
            self._doubt(video_depth_text(name))

    def frames(self) -> Iterator[RawFrame]:
        """Yield the frames in the order of their stamps. Raises DriveError if the bag is damaged or no image can be
        used."""
        return self.frames_where(lambda _: True)

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames of wanted moments; images of other moments are not decoded."""
        # The messages of the survey are read again, perhaps with another clock or from another topic.
        self._tree.forget_motion()
        odometry = self._files.topics.get(self._topics.odometry or "")
        if odometry is not None and odometry.msgtype == PATH:
            poses = path_poses(self._files, odometry.name)
            self._path = deque((stamp - self._path_lag_s, pose) for stamp, pose in poses)
        for matched in self._matches():
            frame = self._frame(matched, wanted)
            if frame is not None:
                yield frame
        for sentence in self._outages.sentences():
            self._doubt(sentence)
        if self._last_stamp == float("-inf"):
            said = ", ".join(f"{count} with {reason}" for reason, count in self.dropped.items()) or "it holds none"
            raise DriveError(
                f"{self._files.path}: no image of {self._topics.rgb} can be used ({said}); {' '.join(self.doubts)} "
                "Choose other topics with --rgb, --depth and --odometry; `none` omits one."
            )

    def _matches(self) -> Iterator[MatchedImages]:
        period_s = self._files.duration_s / max(self._files.topics[self._topics.rgb].count, 1)
        world, carrier = self._rig.world, self._rig.carrier
        matcher = StampMatcher(
            needs_depth=self._topics.depth is not None,
            tolerance_s=min(max(period_s / 2, _TOLERANCES_S[0]), _TOLERANCES_S[1]),
            is_known=lambda stamp: not world or self._tree.newest_s(world, carrier) >= stamp,
        )
        for raw in self._files.messages({*self._topics.roles(), *self._transforms}):
            self._take(raw, matcher)
            yield from matcher.ready(raw.log_s)
        matcher.colours.extend([] if self._video is None else self._video.rest())
        yield from matcher.ready(float("inf"))

    def _take(self, raw: RawMessage, matcher: StampMatcher) -> None:
        message = self._files.decode(raw)
        if raw.msgtype in TRANSFORMS:
            skip = "" if self._edge is None else self._edge.child
            add_transforms(self._tree, message, raw, by_log=self._by_log, skip=skip)
            return
        stamp = 0.0 if self._by_log else stamp_s(message)
        is_stamped = stamp > 0 or (self._is_zero_a_time and not self._by_log)
        image = PendingImage(stamp if is_stamped else raw.log_s, raw.log_s, message, len(raw.data))
        while self._edge is not None and self._path and self._path[0][0] <= image.stamp + _PATH_AHEAD_S:
            posed_s, pose = self._path.popleft()
            self._outages.add_pose(posed_s)
            self._tree.add_moving(self._edge.parent, self._edge.child, posed_s, pose @ self._body)
        if raw.topic == self._topics.rgb:
            if self._video is None and raw.topic not in self._samples:  # The topic was silent during the survey.
                self._samples[raw.topic] = message
                self._video = self._video_of(message)
            matcher.colours.extend([image] if self._video is None else self._video.pictures(image))
        elif raw.topic == self._topics.depth:
            matcher.add_depth(image)
        elif raw.msgtype == PATH:
            return
        elif raw.topic in (self._topics.odometry, self._topics.truth):
            self._take_pose(raw.topic, message, image.stamp)
        else:
            self._samples.setdefault(raw.topic, message)

    def _video_of(self, message: Any) -> VideoStream | None:
        """Return the decoder if the colours are a video, otherwise None. Raises DriveError, and MissingLibraryError."""
        form = str(getattr(message, "format", ""))
        return VideoStream(self._topics.rgb, form, self._drop_packet) if is_video(form) else None

    def _drop_packet(self, reason: str) -> None:
        self.dropped[reason] += 1
        if reason == DAMAGED:
            self._doubt(
                f"Packets of the video {self._topics.rgb} cannot be decoded; images from there to the next key frame "
                "are left out. If packets get lost, make the encoder send key frames more often."
            )

    def _take_pose(self, topic: str, message: Any, stamp: float) -> None:
        pose = transform(*ros_pose(message))
        if topic == self._topics.truth:
            if pose is None:
                self._doubt(f"Some poses of {topic} are not finite; they are left out.")
            else:
                self._truth.add(stamp, pose)
            return
        fault = "" if pose is not None else NULL if np.isfinite(np.concatenate(ros_pose(message))).all() else NOT_FINITE
        if not fault and self._says_loss and is_lost(message):
            fault = LOST
        self._outages.add_pose(stamp, fault)
        if not fault and pose is not None and self._edge is not None:
            self._tree.add_moving(self._edge.parent, self._edge.child, stamp, pose @ self._body)

    def _frame(self, matched: MatchedImages, wanted: FrameFilter) -> RawFrame | None:
        """Return a frame; None if it was left out or is not wanted."""
        stamp = matched.colours.stamp
        pose = self._rig.pose(self._tree, stamp)
        if self._rig.world:
            self._outages.add_image(stamp, has_pose=pose is not None)
        if stamp <= self._last_stamp:
            reason = NOT_LATER
        elif self._topics.depth is not None and matched.depth is None:
            reason = NO_DEPTH
        elif self._rig.world and pose is None:
            reason = NO_POSE
        else:
            robot = self._truth.at(stamp)
            truth = None if robot is None else robot @ self._rig.mounting.camera_on_robot
            moment = FrameMoment(
                stamp=stamp,
                odometry=None if pose is None else pose.planar,
                truth=None if truth is None else spatial_pose(truth[:3, 3], truth[:3, :3]).planar,
                tilt=None if pose is None else self._rig.mounting.own_tilt(pose.tilt),
            )
            try:
                frame = self._decoder.decode(matched, moment) if wanted(moment) else None
                self._last_stamp = stamp
                return frame
            except DriveError as error:
                reason = DAMAGED
                if not self.dropped[DAMAGED]:
                    self._doubt(f"An image was left out: {error}")
        self.dropped[reason] += 1
        return None

    def _lacks_stamps(self, found: BagSurvey) -> bool:
        """Tell whether all stamps of the topics in use are 0; then the time of recording is used."""
        used = [topic for topic in self._topics.moments() if topic in found.samples]
        if not used or any(topic in found.earliest_s for topic in used):
            return False
        self._doubt(
            f"The messages of {', '.join(used)} have no stamps, so the time of recording is used; make the robot's "
            "drivers set header.stamp."
        )
        return True

    def _has_clocks_apart(self, found: BagSurvey) -> bool:
        """Tell whether the times of recording are better than the stamps, because these come from different clocks."""
        moving = [] if self._topics.odometry else [name for name in self._transforms if not is_static(name)]
        leads = {topic: found.lead_s(topic) for topic in (*self._topics.moments(), *moving)}
        known = {topic: lead for topic, lead in leads.items() if lead is not None}
        apart_s = max(known.values()) - min(known.values()) if known else 0.0
        if apart_s < _PERHAPS_APART_S:
            return False
        said = f"The stamps of the topics differ by up to {apart_s:.3g} s for messages that were recorded together"
        steady = apart_s >= _CLOCKS_APART_S or all(found.is_steady(topic, apart_s / 2) for topic in known)
        in_future = max(known.values()) >= _AHEAD_S > min(known.values())
        if steady and (apart_s >= _SURELY_APART_S or in_future):
            self._doubt(
                f"{said}, so the time of recording is used; synchronise the clocks of all machines before you record."
            )
            return True
        if steady:
            first = min(known, key=lambda topic: known[topic])
            self._doubt(
                f"{said}: {first} is late. If its messages took that long on their way, all is well; if its clock is "
                "slow, poses are wrong by the way driven in that time."
            )
        return False

    def _odometry_frames(self, options: ReadOptions) -> FrameEdge | None:
        """Return the frames of the odometry topic; None if the transform tree gives the odometry."""
        if options.odometry == NOTHING:
            return FrameEdge("", robot_frame(self._tree))
        odometry = self._samples.get(self._topics.odometry or "")
        if odometry is None:
            return None
        child = frame_name(getattr(odometry, "child_frame_id", "")) or robot_frame(self._tree)
        if upright_name(child) in self._tree.frames:  # The camera is on `base_link`, not on `base_link_frd`.
            self._body = upright(child)
            child = upright_name(child)
        return FrameEdge(frame_name(odometry.header.frame_id) or "odom", child)

    def _find_rig(self) -> CameraRig:
        image = self._samples.get(self._topics.rgb)
        camera_frame = "" if image is None else frame_name(image.header.frame_id)
        begin = 0.0 if image is None else stamp_s(image)
        rig = find_rig(self._tree, camera_frame, self._edge, begin)
        if rig.carrier != camera_frame and camera_frame:
            survey_frames(self._files, self._tree, self._transforms)
            self._tree.settle_still(camera_frame, rig.carrier)
            rig = find_rig(self._tree, camera_frame, self._edge, max(begin, self._tree.first_s(camera_frame)))
        if rig.world and rig.mounting.tilt is None and rig.carrier != camera_frame:
            self._doubt(
                f"The bag does not say where {camera_frame or 'the camera'} is on {rig.carrier}; it is assumed to "
                "look straight ahead from there. Record /tf_static as well."
            )
        return rig

    def _doubt(self, sentence: str) -> None:
        if sentence not in self.doubts and len(self.doubts) < _MOST_DOUBTS:
            self.doubts.append(sentence)
