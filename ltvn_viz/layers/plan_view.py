"""The plan view: the map from above, which each page draws by itself (`static/plan_draw.js`).

Owns what is sent to the pages: the robot's pose many times a second, the path that was driven once a second, and all
else when it changes. Pages fetch the map (`map_changes`) and pictures of floors by number.
"""

import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import LtvnError
from ltvn_core.palette import Rgb8
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.simulation.changes.world import outline_of
from ltvn_core.simulation.scene import room_names
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Pose
from ltvn_core.worlds import AS_MADE, DoorMoved, ThingKind, WorldState
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.layers.map_changes import MapChanges
from ltvn_viz.layers.scene_assets import PICTURE_PX, FloorPicture, without_guests
from ltvn_viz.server.drive_socket import Newest
from ltvn_viz.session.inspection import Overlay, QuestionName
from ltvn_viz.session.snapshot import FloorPlanView, Snapshot

ROBOT_EVERY_S, VIEW_EVERY_S, MAP_EVERY_S, PATH_EVERY_S = 1 / 40, 0.1, 0.3, 1.0
"""Least intervals between two messages about the robot, the view, the map and the driven path, in seconds."""
_MOST_LABELS = 24
_KEPT_PICTURES = 4
_QUALITY = 85


class PlanView:
    """Sends the plan view to the pages."""

    def __init__(
        self,
        tell: Callable[[Newest, str], None],
        load_picture: Callable[[str, WorldState], FloorPicture | None],
        robot: RobotSpec,
        floor: Floor,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Send messages by `tell`, which returns at once; `load_picture` draws a scene from above.

        `floor` is shown as long as neither a picture nor a map tells the extent of the place.
        """
        self.changes = MapChanges()
        self._tell = tell
        self._load_picture = load_picture
        self._robot = robot
        self._floor = [*np.asarray(floor.low).tolist(), *np.asarray(floor.high).tolist()]
        self._clock = clock
        self._told: dict[Newest, Any] = {}
        self._due: dict[Newest, float] = {}
        self._map = 0
        self._map_due = self._view_due = float("-inf")
        self._scene: tuple[str, WorldState] = ("", AS_MADE)
        self._picture: FloorPicture | None = None
        self._pictures: dict[int, bytes] = {}
        self._drawn: tuple[Overlay | None, dict[str, Any]] = None, {}
        self._numbers: dict[int, tuple[object, int]] = {}
        self._next_picture = 0

    def picture(self, number: int) -> bytes | None:
        """Return a picture of a floor as a JPEG, or as a PNG if parts are transparent; None for an unknown number.

        May be called in any thread.
        """
        return self._pictures.get(number)

    def show(self, snapshot: Snapshot) -> None:
        """Send what changed since the last snapshot."""
        pose = snapshot.moment.robot
        self._say(Newest.ROBOT, {"type": "robot", "pose": None if pose is None else _rounded(pose)}, ROBOT_EVERY_S)
        if self._clock() >= self._map_due:
            self._map_due = self._clock() + MAP_EVERY_S
            self._map = self.changes.take(snapshot.moment.graph)
        if self._clock() >= self._view_due:
            self._view_due = self._clock() + VIEW_EVERY_S
            self._say(Newest.VIEW, self._view(snapshot))
        self._say_path(Newest.PATH, "path", snapshot.moment.trajectory, PATH_EVERY_S)
        self._say_path(Newest.COURSE, "course", snapshot.course, 0.0)
        self._load_scene(snapshot)

    def _say(self, kind: Newest, message: dict[str, Any], every_s: float = 0.0) -> None:
        if message == self._told.get(kind) or self._clock() < self._due.get(kind, 0.0):
            return
        self._told[kind] = message
        self._due[kind] = self._clock() + every_s
        self._tell(kind, msgspec.json.encode(message, enc_hook=np.generic.item).decode())

    def _say_path(self, kind: Newest, name: str, poses: NDArray[np.float64], every_s: float) -> None:
        if poses is self._told.get(kind) or self._clock() < self._due.get(kind, 0.0):
            return
        self._told[kind] = poses
        self._due[kind] = self._clock() + every_s
        self._tell(kind, msgspec.json.encode({"type": name, "points": poses[:, :2].round(2).tolist()}).decode())

    def _load_scene(self, snapshot: Snapshot) -> None:
        """Draw the scene from above; it takes a second, so all else was sent before."""
        scene = snapshot.scene, without_guests(snapshot.moment.progress.world)
        if scene == self._scene:
            return
        self._scene = scene
        try:
            self._picture = self._load_picture(*scene)
        except LtvnError:
            self._picture = None  # The user's own robot and recordings of unknown scenes have no walls.

    def _view(self, snapshot: Snapshot) -> dict[str, Any]:
        moment = snapshot.moment
        progress = moment.progress
        inspection = snapshot.inspection
        is_asking = inspection.question != QuestionName.FIRST
        goal = snapshot.selected if snapshot.way is None else snapshot.way.goal
        camera = snapshot.lone_camera or self._robot.camera
        floor = None
        if (seen := self._picture) is not None:
            number = self._number(seen, lambda: seen.rgb)
            floor = {"picture": number, "low": seen.low.tolist(), "high": seen.high.tolist()}
        return {
            "type": "view",
            "map": self._map,
            "floor": floor,
            "bounds": self._floor,
            "rooms": rooms_of(snapshot.scene),
            "sheet": None if snapshot.floor_plan is None else self._sheet(snapshot.floor_plan),
            "solids": solids_of(snapshot.scene, progress.world),
            "doors": [] if snapshot.world is None else snapshot.world.doors,
            "boxes": [] if snapshot.world is None else snapshot.world.boxes,
            "aim": _aim(snapshot),
            "asks": is_asking,
            "goal": goal,
            "here": None if progress.localised is None else progress.localised.node,
            "plan": progress.plan,
            "ghost": None if moment.predicted_subgoal is None else _rounded(moment.predicted_subgoal),
            "blocked": sorted(progress.blocked),
            "came": _fading(moment.added_edges.segments, moment.added_edges.ages_s),
            "went": _fading(moment.removed_edges.segments, moment.removed_edges.ages_s),
            "selected": inspection.selection.edge if is_asking else None,
            "radius": self._robot.radius_m,
            "fov": round(float(camera.horizontal_fov_rad), 3),
            **self._overlay(inspection.answer.overlay),
        }

    def _sheet(self, view: FloorPlanView) -> dict[str, Any]:
        x, y, yaw = map(float, view.plan.middle)
        number = self._number(view.plan.cells, lambda: view.plan.picture(PICTURE_PX))
        marks = [_rounded(np.array(mark)) for mark in view.marks]
        return {"picture": number, "pose": [x, y, yaw], "size": list(view.plan.size_m), "marks": marks}

    def _overlay(self, overlay: Overlay) -> dict[str, Any]:
        """Return the drawing of an answer, which stays the same object while the answer does."""
        if overlay is not self._drawn[0]:
            drawn = {
                "strokes": [[*each.start, *each.end, Rgb8(*each.colour).css] for each in overlay.strokes],
                "marks": [[node, Rgb8(*colour).css] for node, colour in overlay.nodes.items()],
                "ghosts": overlay.ghosts,
                "labels": [[*each.at, each.text] for each in overlay.labels[:_MOST_LABELS]],
                "isOfLikeness": overlay.is_of_likeness,
            }
            self._drawn = overlay, drawn
        return self._drawn[1]

    def _number(self, key: object, draw: Callable[[], NDArray[np.uint8]]) -> int:
        """Return the number by which pages fetch a picture, which is encoded when it is shown first."""
        known = self._numbers.get(id(key))
        if known is None:
            known = self._numbers[id(key)] = key, self._next_picture
            self._pictures[self._next_picture] = _encoded(draw())
            self._next_picture += 1
            for old in list(self._numbers)[:-_KEPT_PICTURES]:
                del self._pictures[self._numbers.pop(old)[1]]
        return known[1]


@lru_cache(maxsize=4)
def rooms_of(scene: str) -> list[tuple[str, float, float, float, float]]:
    """Return name, x0, y0, x1 and y1 in metres of each room; none of a scene that is unknown or has no rooms."""
    try:
        rooms = load_scene(scene).rooms if scene else ()
    except LtvnError:
        return []
    return [(name, r.x0, r.y0, r.x1, r.y1) for name, r in zip(room_names(rooms), rooms, strict=True)]


@lru_cache(maxsize=16)
def solids_of(scene: str, world: WorldState) -> list[tuple[float, ...]]:
    """Return x, y, yaw, width and depth of each closed door, added thing and person; none in an unknown scene."""
    added = [
        *(DoorMoved(door, is_open=False) for door in sorted(world.closed_doors)),
        *(thing for thing in world.things if thing.kind is not ThingKind.FURNITURE),
        *world.people,
    ]
    if not added:
        return []
    try:
        base = load_scene(scene)
    except LtvnError:
        return []
    outlines = [outline_of(each, base) for each in added]
    return [(o.x, o.y, o.yaw, o.width, o.depth) for o in outlines if o is not None]


def _aim(snapshot: Snapshot) -> str:
    """Return what the next click on the floor is for; empty if it is for nothing."""
    if snapshot.world is not None and snapshot.world.aimed is not None:
        return "put_box"
    if snapshot.floor_plan is not None and snapshot.floor_plan.node is not None:
        return "point_on_plan"
    return ""


def _encoded(picture: NDArray[np.uint8]) -> bytes:
    if picture.shape[2] == 4:
        return cv2.imencode(".png", picture[..., [2, 1, 0, 3]])[1].tobytes()
    return cv2.imencode(".jpg", picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1].tobytes()


def _rounded(pose: Pose) -> list[float]:
    return pose.round(3).tolist()


def _fading(segments: NDArray[np.float64], ages_s: NDArray[np.float64]) -> list[list[float]]:
    """Return x0, y0, x1, y1 in metres and the age in seconds of each edge."""
    return np.column_stack([segments.reshape(-1, 4).round(3), ages_s.round(1)]).tolist()
