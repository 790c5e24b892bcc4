"""The page's composition: the layers and panels, their places, and the thread that draws them.

Owns the layout and the theme; the content is in `layers` and `panels`. Only the newest snapshot is drawn, so neither a
slow page nor a change of a big map delays the robot or its driver.
"""

import logging
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import viser

from ltvn_core import palette
from ltvn_core.navigation.events import Severity
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.worlds import WorldState
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.layers.floor_plan import FloorPlanLayer
from ltvn_viz.layers.graph_layers import EdgesLayer, NodesLayer
from ltvn_viz.layers.navigation_layers import GoalLayer, PlanLayer
from ltvn_viz.layers.plan_view import PlanView
from ltvn_viz.layers.robot_layers import RobotLayer, TrajectoryLayer
from ltvn_viz.layers.scene_assets import FloorPicture, add_lights, added_glb, scene_glb, scene_picture
from ltvn_viz.layers.scene_layer import AddedLayer, SceneLayer
from ltvn_viz.panels.camera_panel import CameraPanel
from ltvn_viz.panels.command_palette import CommandPalette, list_stop
from ltvn_viz.panels.debugger_panel import DebuggerPanel
from ltvn_viz.panels.drive_panel import DrivePanel, FineTuningPanel, PadPanel
from ltvn_viz.panels.floor_plan_panel import FloorPlanPanel
from ltvn_viz.panels.html_widgets import grey_for_watchers
from ltvn_viz.panels.navigation_panel import NavigationPanel
from ltvn_viz.panels.replay_panel import ReplayPanel, TimelinePanel
from ltvn_viz.panels.status_panel import Notifications, StatusPanel, StoryBar
from ltvn_viz.panels.world_panel import WorldPanel
from ltvn_viz.server.drive_socket import Newest
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.limits import LimitedLog
from ltvn_viz.server.page_messages import shared_elements
from ltvn_viz.session.snapshot import Message, Snapshot
from ltvn_viz.wishes.commands import Command

logger = logging.getLogger(__name__)
_log = LimitedLog(logger)
_NOT_DRAWN = -1
"""Number of the message about parts that could not be drawn; the session's messages count from 0."""


class PagePart(Protocol):
    """A layer or a panel."""

    def show(self, snapshot: Snapshot) -> None:
        """Show `snapshot`."""
        ...


class Painter:
    """Draws the newest snapshot by all layers and panels."""

    def __init__(self, batch: Callable[[], AbstractContextManager[None]]) -> None:
        """Draw within `batch()`, so that the page applies all changes of a snapshot at once."""
        self.parts: Sequence[PagePart] = ()
        self._in_scene: Sequence[PagePart] = ()
        self._shows_scene: Callable[[], bool] = lambda: True
        self._batch = batch
        self._change = threading.Condition()
        self._newest: Snapshot | None = None
        self._failed: list[str] = []
        self._closing = False
        self._thread = threading.Thread(target=self._paint_forever, name="painter", daemon=True)

    def start(self, parts: Sequence[PagePart], in_scene: Sequence[PagePart], shows_scene: Callable[[], bool]) -> None:
        """Begin drawing by these parts, in this order, and by those `in_scene` while a page shows the 3D scene."""
        self.parts, self._in_scene, self._shows_scene = parts, in_scene, shows_scene
        self._thread.start()

    def publish(self, snapshot: Snapshot) -> None:
        """Set the snapshot to draw next, in place of one that is still waiting. Never blocks for long."""
        with self._change:
            self._newest = snapshot
            self._change.notify()

    def paint(self, snapshot: Snapshot) -> None:
        """Draw one snapshot now; a part that fails is named on the page, and does not keep the others from drawing."""
        snapshot = self._with_failure(snapshot)
        self._failed = []
        with self._batch():
            for part in (*self.parts, *(self._in_scene if self._shows_scene() else ())):
                try:
                    part.show(snapshot)
                except Exception:
                    self._failed.append(type(part).__name__)
                    _log.log(logging.ERROR, "%s could not be drawn\n%s", self._failed[-1], traceback.format_exc())

    def _with_failure(self, snapshot: Snapshot) -> Snapshot:
        """Return a snapshot whose message names the parts that could not be drawn last time, if there are any."""
        if not self._failed:
            return snapshot
        text = f"These parts of the page could not be drawn: {', '.join(self._failed)}. The terminal says why."
        return replace(snapshot, message=Message(text, Severity.ERROR, _NOT_DRAWN))

    def close(self) -> None:
        """Stop drawing."""
        with self._change:
            self._closing = True
            self._change.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _paint_forever(self) -> None:
        while (snapshot := self._next()) is not None:
            self.paint(snapshot)

    def _next(self) -> Snapshot | None:
        with self._change:
            self._change.wait_for(lambda: self._closing or self._newest is not None)
            snapshot, self._newest = self._newest, None
            return None if self._closing else snapshot


TITLE = "Lifelong Topological Visual Navigation"


@dataclass(frozen=True, slots=True)
class PageAssets:
    """Functions and data from which the static parts of the page are drawn."""

    robot: RobotSpec
    robot_glb: bytes | None
    """The robot's body as binary glTF; None draws a cylinder of its size."""
    scene_glb: Callable[[str, WorldState], bytes] = scene_glb
    """Returns a scene, given its name and state, as binary glTF without the ceiling; raises SceneError."""
    scene_picture: Callable[[str, WorldState], FloorPicture | None] = scene_picture
    """Draws a scene from above, for pages that draw slowly; None if it cannot be drawn. Raises SceneError."""
    added_glb: Callable[[str, WorldState], bytes | None] = added_glb
    """Returns the temporary parts of a scene, such as closed doors and people; None if there are none. Raises
    SceneError."""


def build_layout(
    server: GuardedServer, send: Callable[[Command], None], assets: PageAssets, floor: Floor
) -> tuple[list[PagePart], list[PagePart]]:
    """Add all layers and panels to the page, which begins with a view of `floor`.

    `send` takes the commands of viser's own controls and uploads, which `server` accepts from the driver's page only.
    Returns the parts in drawing order, and those of the 3D scene.
    """
    floor.begin(server.viser)
    accent = (palette.ACCENT.red, palette.ACCENT.green, palette.ACCENT.blue)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=accent)
    server.gui.set_panel_label(TITLE)
    plan_view = PlanView(server.tell, assets.scene_picture, assets.robot, floor)
    server.add_route("/map/", plan_view.changes.since, ending="json")
    server.add_route("/floor/", plan_view.picture, ending="bin")
    return [plan_view, *_panels(server, send)], _layers(server.scene, assets)


def _panels(server: GuardedServer, send: Callable[[Command], None]) -> list[PagePart]:
    gui = server.gui

    status = StatusPanel(gui)
    tabs = gui.add_tab_group()
    with tabs.add_tab("Drive", viser.Icon.STEERING_WHEEL):
        drive = DrivePanel(gui)
        learn = FineTuningPanel(gui)
    with tabs.add_tab("Go", viser.Icon.MAP_PIN):
        go = NavigationPanel(gui, send, server.file_address)
    with tabs.add_tab("World", viser.Icon.DOOR):
        world = WorldPanel(gui)
        floor_plan = FloorPlanPanel(gui)
    with tabs.add_tab("Replay", viser.Icon.HISTORY):
        replay = ReplayPanel(gui)
    with tabs.add_tab("Why", viser.Icon.ZOOM_QUESTION):
        why = DebuggerPanel(gui, send)
    gui.add_html(grey_for_watchers(shared_elements(gui)))
    camera = CameraPanel(gui, partial(server.tell, Newest.PICTURE), partial(server.tell, Newest.LARGER))

    # Each page has a stop of its own, which needs no seat.
    server.viser.on_client_connect(lambda client: list_stop(client.gui, partial(server.stop_for, client.client_id)))
    return [
        status,
        camera,
        drive,
        learn,
        go,
        world,
        floor_plan,
        replay,
        why,
        TimelinePanel(partial(server.tell, Newest.MOMENT)),
        PadPanel(partial(server.tell, Newest.ACTIVITY)),
        CommandPalette(gui, send),
        StoryBar(gui),
        Notifications(lambda: list(server.viser.get_clients().values())),
    ]


def _layers(scene: viser.SceneApi, assets: PageAssets) -> list[PagePart]:
    add_lights(scene)
    return [
        FloorPlanLayer(scene),
        RobotLayer(scene, assets.robot, assets.robot_glb),
        SceneLayer(scene, assets.scene_glb),
        AddedLayer(scene, assets.added_glb),
        NodesLayer(scene),
        PlanLayer(scene),
        GoalLayer(scene),
        TrajectoryLayer(scene),
        EdgesLayer(scene),
    ]
