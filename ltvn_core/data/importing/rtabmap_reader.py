"""Reads databases of RTAB-Map: a drive with colours, depth, odometry, and the optimised map if it has loop closures.

Folders that RTAB-Map exported are read by `rtabmap.export_reader`, which is opened from here.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.encoded_images import decode_colour, decode_depth, decode_rvl
from ltvn_core.data.importing.file_drive import FileDriveReader, ReadableDepths
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.rtabmap.database import Node, NodeImages, RigCamera, RtabmapDatabase, parse_calibration
from ltvn_core.data.importing.rtabmap.export_reader import EXPORT
from ltvn_core.data.importing.source_camera import fitted
from ltvn_core.data.importing.spatial_pose import CameraMounting, SpatialPose, Transform, spatial_pose
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.types import Depth

_RVL = b"DEPTHRVL"
_COVERED = 0.95
"""Least share of the nodes that the optimised map must contain to count as ground truth."""

DAMAGED = "damaged image"
OTHER_SESSION = "of another drive"
NOT_LATER = "not later than the image before"


class RtabmapReader:
    """A database of RTAB-Map that is open for reading."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        """Open the database and read the poses of its nodes. Raises DriveError."""
        self._database = RtabmapDatabase(path)
        self._options = options
        self._camera_number = _camera_number(options.rgb)
        self.dropped: Counter[str] = Counter()
        self.doubts: list[str] = []
        self._if_readable = ReadableDepths()
        self._nodes = self._one_session(self._database.nodes())
        self._truth = self._true_poses()
        streams = (
            SourceFact("rgb", "Data.image", len(self._nodes)),
            SourceFact("odometry", "Node.pose", sum(node.odometry is not None for node in self._nodes)),
            SourceFact("truth", "Admin.opt_poses or Node.ground_truth_pose", len(self._truth)),
            SourceFact("", "Link (loop closures)", self._database.closures()),
        )
        self.facts = DriveFacts(
            format="rtabmap",
            frames=len(self._nodes),
            streams=[stream for stream in streams if stream.count],
            place=path.resolve().stem,
        )

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path has the name of a database, or is a folder that RTAB-Map exported; never raises."""
        try:
            return (path.suffix == ".db" and path.is_file()) or EXPORT.recognises(path)
        except OSError:
            return False

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> "RtabmapReader | FileDriveReader":
        """Open a database or an exported folder. Raises DriveError."""
        return EXPORT.open(path, options) if path.is_dir() else cls(path, options)

    def frames(self) -> Iterator[RawFrame]:
        """Yield the nodes as frames in the order of their stamps. Raises DriveError where none can be read."""
        last = float("-inf")
        for node in self._nodes:
            if node.stamp <= last:
                self.dropped[NOT_LATER] += 1
                continue
            try:
                yield self._frame(node)
                last = node.stamp
            except DriveError as error:
                self.dropped[DAMAGED] += 1
                if self.dropped[DAMAGED] == 1:
                    self.doubts.append(f"An image was left out: {error}")
        self.doubts += self._if_readable.doubts
        if last == float("-inf"):
            raise DriveError(f"{self._database.path} has no image that can be read. {' '.join(self.doubts)}")

    def _frame(self, node: Node) -> RawFrame:
        name = f"node {node.id}"
        images = self._database.images(node)
        rig = self._cameras(images, name)
        camera = rig[self._camera_number] if rig else None
        mounting = CameraMounting.unknown() if camera is None else CameraMounting.of(camera.place)
        rgb = _one_camera(decode_colour(images.colours, name), len(rig), self._camera_number, name)
        odometry = _camera_pose(node.odometry, mounting)
        truth = _camera_pose(self._truth.get(node.id), mounting)
        known = odometry or truth
        height, width = rgb.shape[:2]
        return RawFrame(
            stamp=node.stamp,
            rgb=rgb,
            depth_m=self._if_readable(lambda: self._depth(images, rig, name)),
            camera=self._lens(camera, mounting, width, height, name),
            odometry=None if odometry is None else odometry.planar,
            truth=None if truth is None else truth.planar,
            tilt=None if known is None else mounting.own_tilt(known.tilt),
            name=name,
        )

    def _cameras(self, images: NodeImages, name: str) -> list[RigCamera]:
        if not images.calibration:
            return []
        rig = parse_calibration(images.calibration, self._database.version, name)
        if self._camera_number >= len(rig):
            raise DriveError(
                f"{name} has {len(rig)} cameras, counted from 0, and --rgb asks for {self._camera_number}."
            )
        if len(rig) > 1 and self._options.rgb is None:
            doubt = f"Each node has {len(rig)} cameras side by side; the first was read. Choose with --rgb 0, 1 ..."
            self.doubts += [doubt] if doubt not in self.doubts else []
        return rig

    def _lens(
        self, camera: RigCamera | None, mounting: CameraMounting, width: int, height: int, name: str
    ) -> CameraModel | None:
        if self._options.camera is not None:
            return mounting.mounted(fitted(self._options.camera, width, height, name))
        try:
            return None if camera is None else mounting.mounted(camera.fitted(width, height))
        except CameraError as error:
            raise DriveError(f"{name}: {error}; give the lens with --camera.") from error

    def _depth(self, images: NodeImages, rig: list[RigCamera], name: str) -> Depth | None:
        if images.depth is None or self._options.depth == NOTHING or (rig and rig[0].is_stereo):
            return None
        unit_m = self._options.depth_unit_m or MILLIMETRES
        if images.depth.startswith(_RVL):
            columns, rows = (int(number) for number in np.frombuffer(images.depth[8:16], "<u4"))
            depth = decode_rvl(images.depth[16:], columns, rows, name) * np.float32(unit_m)
        else:
            depth = decode_depth(images.depth, unit_m, name)
        return _one_camera(depth, len(rig), self._camera_number, name)

    def _one_session(self, nodes: list[Node]) -> list[Node]:
        """Return the nodes of the longest session, sorted by stamps; sorted by ids if there are no stamps."""
        if not nodes:
            raise DriveError(
                f"{self._database.path} holds no images; set RTAB-Map's Mem/BinDataKept to true and drive again."
            )
        sessions = Counter(node.session for node in nodes)
        longest = sessions.most_common(1)[0][0]
        if len(sessions) > 1:
            self.dropped[OTHER_SESSION] = len(nodes) - sessions[longest]
            self.doubts.append(
                f"The database holds {len(sessions)} drives, and odometry starts over in each; the longest was read."
            )
        chosen = [node for node in nodes if node.session == longest]
        if all(node.stamp > 0 for node in chosen):
            return sorted(chosen, key=lambda node: node.stamp)
        return [replace(node, stamp=float(count)) for count, node in enumerate(chosen)]

    def _true_poses(self) -> dict[int, Transform]:
        """Return RTAB-Map's ground truth; without it, the optimised map if it has loop closures."""
        told = {node.id: node.truth for node in self._nodes if node.truth is not None}
        if told:
            return told
        optimised = self._database.optimised()
        closures = self._database.closures()
        if not closures or sum(node.id in optimised for node in self._nodes) < _COVERED * len(self._nodes):
            return {}
        self.doubts.append(
            f"The true poses are those of RTAB-Map's own map, optimised over {closures} loop closures: useful for an "
            "evaluation, but not measured."
        )
        return optimised


def _camera_number(said: str | None) -> int:
    if said is None:
        return 0
    if not said.isdecimal() or len(said) > 3:
        raise DriveError(
            f"--rgb must be the number of a camera of the RTAB-Map database, counted from 0, got {said!r:.40}."
        )
    return int(said)


def _camera_pose(robot: Transform | None, mounting: CameraMounting) -> SpatialPose | None:
    if robot is None:
        return None
    camera = robot @ mounting.camera_on_robot
    return spatial_pose(camera[:3, 3], camera[:3, :3])


def _one_camera(image: np.ndarray, cameras: int, number: int, name: str) -> np.ndarray:
    """Return the image of one camera from an image with several cameras side by side."""
    if cameras <= 1:
        return image
    width, rest = divmod(image.shape[1], cameras)
    if rest or not width:
        raise DriveError(f"{name}: an image {image.shape[1]} wide is not a row of {cameras} cameras.")
    return np.ascontiguousarray(image[:, number * width : (number + 1) * width])
