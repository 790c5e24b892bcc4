"""Goals with pictures, and the place of a single picture in a map.

Owns the choice of offered goals, their thumbnails, and the sentence about the place of a picture. Pictures come from
the map in the worker's thread. The predictor compares pictures, and the localiser's thresholds decide; a single picture
has no temporal support.
"""

import threading
from base64 import b64encode
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.localisation_confidence import localisation_heat_map
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError, MapError
from ltvn_core.graph.matching import Matcher
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.preprocessing import preprocess_image
from ltvn_core.types import FrameId, NodeId, Observation, Pose, Predictor, Rgb, is_usable
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.snapshot import UploadMatch, WayNodes
from ltvn_viz.session.worker import Worker

LIMIT = 512


class ThumbnailStore:
    """The latest pictures for the panels."""

    def __init__(self) -> None:
        """Start empty."""
        self._lock = threading.Lock()
        self._jpegs: OrderedDict[FrameId, bytes] = OrderedDict()

    def __contains__(self, frame: FrameId) -> bool:
        """Tell whether a picture is in the store."""
        with self._lock:
            return frame in self._jpegs

    def put(self, frame: FrameId, rgb: Rgb) -> None:
        """Store a picture (H, W, 3); drop the oldest if there are too many."""
        jpeg = _jpeg(rgb)
        with self._lock:
            self._jpegs[frame] = jpeg
            self._jpegs.move_to_end(frame)
            while len(self._jpegs) > LIMIT:
                self._jpegs.popitem(last=False)

    def get(self, frame: FrameId) -> bytes | None:
        """Return a picture as JPEG. May be called from any thread."""
        with self._lock:
            return self._jpegs.get(frame)


def node_picture(observation: Callable[[FrameId], Observation | None], frame: FrameId) -> bytes | None:
    """Return the image of a node on show as a JPEG; None if it cannot be read. May be called in any thread."""
    try:
        seen = observation(frame)
    except LtvnError:
        return None
    return None if seen is None else _jpeg(seen.rgb)


GALLERY_SIZE = 12
SIMILAR_NODE_COUNT = 4
GROWTH = 1.15
"""Factor of growth of the map after which the gallery is chosen again, so that it does not flicker during driving."""
RADIAN_IN_M = 0.5
"""Distance in metres that makes two views as different as a turn by one radian."""


class Goals:
    """The offered goals and the chosen one."""

    def __init__(self, live_map: LiveMap, worker: Worker) -> None:
        """Offer places of the live map."""
        self._live_map = live_map
        self._worker = worker
        self.thumbnails = ThumbnailStore()
        self.selected: NodeId | None = None
        self.gallery: tuple[NodeId, ...] = ()
        self.way: WayNodes | None = None
        self.upload: UploadMatch | None = None
        self._graph: GraphArrays | None = None
        self._followed: WayNodes | None = None
        self._chosen_of = 0

    def refresh(self, graph: GraphArrays) -> None:
        """Update the gallery to the map."""
        if graph is self._graph:
            return
        self._graph = graph
        known = set(graph.ids.tolist())
        if self.selected not in known:
            self.selected = None
        if self.upload is not None:
            still = tuple(place for place in self.upload.places if place.node in known)
            self.upload = replace(self.upload, places=still) if still else None
        grown = len(known) >= self._chosen_of * GROWTH or len(self.gallery) < min(GALLERY_SIZE, len(known))
        if grown or not known.issuperset(self.gallery):
            self._chosen_of = len(known)
            self.offer([int(graph.ids[row]) for row in farthest_points(graph.poses, GALLERY_SIZE)])

    def follow(self, way: WayNodes | None) -> None:
        """Show the nodes of a running query once their pictures are in memory; None ends that."""
        if way is None or way == self._followed:
            self.way = None if way is None else self.way
            self._followed = way
            return
        self._followed = way
        nodes = [node for node in way if node is not None]

        def show(node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
            self._keep(node_images)
            if way == self._followed and len(node_images) == len(nodes):
                self.way = way

        self._worker.submit(lambda: self._live_map.node_images(nodes), show)

    def offer(self, nodes: Sequence[NodeId]) -> None:
        """Offer these nodes once their pictures are in memory."""

        def show(node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
            self._keep(node_images)
            self.gallery = tuple(frame for frame, _ in node_images)

        self._worker.submit(lambda: self._live_map.node_images(nodes), show)

    def offer_match(self, match: UploadMatch, node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
        """Offer nodes that look like an upload."""
        self._keep(node_images)
        self.upload = match

    def _keep(self, node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
        for frame, rgb in node_images:
            self.thumbnails.put(frame, rgb)


OWN_WIDTH = 240
"""Width in pixels of the copy of an uploaded picture that is shown beside the similar places."""


def picture_address(rgb: Rgb) -> str:
    """Return a data URL with a small copy of a picture (H, W, 3), so that no file is needed."""
    rows, columns = rgb.shape[:2]
    width = min(OWN_WIDTH, columns)
    small = cv2.resize(rgb, (width, max(1, round(rows * width / columns))), interpolation=cv2.INTER_AREA)
    return f"data:image/jpeg;base64,{b64encode(_jpeg(small.astype(np.uint8))).decode('ascii')}"


def _jpeg(rgb: Rgb) -> bytes:
    return cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()


def farthest_points(poses: Pose, count: int) -> NDArray[np.int64]:
    """Return up to `count` rows of poses (N, 3) that lie far from each other, farthest point first."""
    if not len(poses):
        return np.empty(0, np.int64)
    embedded = np.concatenate(
        [poses[:, :2], RADIAN_IN_M * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)], axis=1
    )
    chosen = [int(np.argmin(np.linalg.norm(embedded - embedded.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(embedded - embedded[chosen[0]], axis=1)
    while len(chosen) < min(count, len(poses)) and gap.max() > 0:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(embedded - embedded[chosen[-1]], axis=1))
    return np.array(chosen)


_NO_STEP = -1
"""The step of a picture that belongs to no drive."""


class FoundPlace(NamedTuple):
    """Result of looking up a picture in a map."""

    node: NodeId | None
    """Node where the picture was taken; None if that place is not in the map."""
    best: NodeId
    """The most similar node."""
    reachability: float
    """r from the picture to the most similar node."""
    waypoint: Pose
    """Pose (3,) of the most similar node in the picture's frame, in metres and radians."""

    @property
    def text(self) -> str:
        """The result in words."""
        if self.node is None:
            return (
                f"The image was not taken in this map: node {self.best} is most like it, with r = "
                f"{self.reachability:.2f}."
            )
        x, y, turn = self.waypoint
        return (
            f"The image was taken at node {self.node}: r = {self.reachability:.2f}; the node's own image was taken "
            f"{abs(x):.2f} m {'ahead' if x >= 0 else 'behind'} and {abs(y):.2f} m {'left' if y >= 0 else 'right'} of "
            f"it, turned by {np.degrees(turn):.0f}°."
        )


class PlaceLookup:
    """Finds the place of pictures in maps; caches the last map. Use it only in the worker's thread."""

    def __init__(self) -> None:
        """Start without a map."""
        self._opened: tuple[tuple[Path, int, str], TopologicalMap] | None = None

    def find(self, path: Path, rgb: Rgb, in_use: Predictor) -> FoundPlace:
        """Find the place of a picture (H, W, 3) of any size in the map at the end of a recording.

        `in_use` is the open predictor, which is used instead of opening the map's own if both are the same. Raises
        RecordingError, MapError, OptionError and WeightsError.
        """
        known = self._map(path, in_use)
        predictor = known.predictor
        nodes = list(known.graph.nodes)
        image = preprocess_image(rgb, "the uploaded image", target=predictor.camera)
        seen = Observation(image, None, np.zeros(3), stamp=0.0, step=_NO_STEP)
        if not nodes:
            raise MapError("The map of this recording is empty; press “Build a map” (B) to make one from it.")
        if not is_usable(seen, predictor):
            raise MapError(
                f"This map was built by {known.predictor_name or predictor.fingerprint}, which needs depth, but an "
                "uploaded image has none. Open a map that was built with --predictor geometric."
            )
        matcher = Matcher(predictor, known.keyframes, known.system.method.matching)
        features = predictor.encode([seen])
        heat = localisation_heat_map(features, nodes, matcher, known.system.method.localising)
        best = heat.best(1)[0]
        matched = matcher.match(features, [best])
        is_here = bool(heat.near[heat.nodes.index(best)])
        return FoundPlace(best if is_here else None, best, float(matched.reachability[0]), matched.waypoints[0])

    def _map(self, path: Path, in_use: Predictor) -> TopologicalMap:
        key = path, path.stat().st_mtime_ns, in_use.fingerprint
        if self._opened is None or self._opened[0] != key:
            made_by = Recording.open(path).meta.fingerprint
            predictor = in_use if made_by == in_use.fingerprint else None
            known = TopologicalMap.load(path, predictor, with_reserve=False)
            self._opened = key, known
        return self._opened[1]
