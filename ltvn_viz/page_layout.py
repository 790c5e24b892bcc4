"""The page's composition: which layers and panels there are, and where they stand.

Owns the layout and the theme. What each shows is in `layers` and `panels`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import viser

from ltvn_core import palette
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_viz.layers.changes_layer import ChangesLayer
from ltvn_viz.layers.debugger_layer import DebuggerLayer
from ltvn_viz.layers.graph_layers import EdgesLayer, NodesLayer
from ltvn_viz.layers.lights_and_camera import add_lights
from ltvn_viz.layers.navigation_layers import GhostLayer, GoalLayer, PlanLayer
from ltvn_viz.layers.robot_layer import RobotLayer
from ltvn_viz.layers.scene_layer import SceneLayer
from ltvn_viz.layers.trajectory_layer import TrajectoryLayer
from ltvn_viz.painter import PagePart
from ltvn_viz.panels.camera_panel import CameraPanel
from ltvn_viz.panels.debugger_panel import DebuggerPanel
from ltvn_viz.panels.drive_panel import DrivePanel
from ltvn_viz.panels.fine_tuning_panel import FineTuningPanel
from ltvn_viz.panels.follow_camera import FollowCamera
from ltvn_viz.panels.html_widgets import grey_for_watchers, legend_html
from ltvn_viz.panels.navigation_panel import NavigationPanel
from ltvn_viz.panels.notifications import Notifications
from ltvn_viz.panels.replay_panel import ReplayPanel
from ltvn_viz.panels.status_panel import StatusPanel
from ltvn_viz.server.page_elements import shared_elements
from ltvn_viz.session.commands import Command, PickNode

PANEL_PX = 380
CAMERA_PX = 520
TITLE = "Lifelong Topological Visual Navigation"


@dataclass(frozen=True, slots=True)
class PageAssets:
    """What is drawn from files."""

    scene_glb: Callable[[str], bytes]
    """Loads the scene of a name, ceiling cut away; raises SceneError."""
    robot_glb: bytes | None
    """The robot's body; None draws a plain one of its size."""
    robot: RobotSpec = LOCOBOT


def build_layout(server: viser.ViserServer, send: Callable[[Command], None], assets: PageAssets) -> Sequence[PagePart]:
    """Put all layers and panels onto a page; returns them in the order in which they should be drawn."""
    accent = (palette.ACCENT.red, palette.ACCENT.green, palette.ACCENT.blue)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=accent)
    server.gui.set_panel_label(TITLE)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_PX)
    return [*_panels(server, send), *_layers(server.scene, send, assets)]


def _panels(server: viser.ViserServer, send: Callable[[Command], None]) -> list[PagePart]:
    gui = server.gui

    def clients() -> list[viser.ClientHandle]:
        return list(server.get_clients().values())

    status = StatusPanel(gui)
    tabs = gui.add_tab_group()
    with tabs.add_tab("Drive", viser.Icon.STEERING_WHEEL):
        drive, learn, follow = DrivePanel(gui), FineTuningPanel(gui), FollowCamera(gui, clients)
    with tabs.add_tab("Go", viser.Icon.MAP_PIN):
        go = NavigationPanel(gui, send)
    with tabs.add_tab("Replay", viser.Icon.HISTORY):
        replay = ReplayPanel(gui, send)
    with tabs.add_tab("Why", viser.Icon.ZOOM_QUESTION):
        why = DebuggerPanel(gui, send)
    gui.add_html(legend_html() + grey_for_watchers(shared_elements(gui)))
    window = gui.add_panel()
    with window.add_tab("Camera and depth", viser.Icon.CAMERA):
        camera = CameraPanel(gui)
    window.float(x=-16, y=-16, width=CAMERA_PX)
    return [status, camera, drive, learn, follow, go, replay, why, Notifications(clients)]


def _layers(scene: viser.SceneApi, send: Callable[[Command], None], assets: PageAssets) -> list[PagePart]:
    add_lights(scene)
    return [
        RobotLayer(scene, assets.robot, assets.robot_glb),
        SceneLayer(scene, assets.scene_glb),
        NodesLayer(scene, on_pick=lambda node: send(PickNode(node))),
        PlanLayer(scene),
        GoalLayer(scene),
        GhostLayer(scene, assets.robot),
        ChangesLayer(scene),
        TrajectoryLayer(scene),
        EdgesLayer(scene),
        DebuggerLayer(scene),
    ]
