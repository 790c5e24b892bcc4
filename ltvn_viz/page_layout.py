"""The page's composition: which layers and panels there are, and where they stand.

Owns the layout and the theme. What each shows is in `layers` and `panels`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import viser

from ltvn_core import palette
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.worlds.world_state import WorldState
from ltvn_viz.layers.boxes_layer import BoxesLayer
from ltvn_viz.layers.changes_layer import ChangesLayer
from ltvn_viz.layers.debugger_layer import DebuggerLayer
from ltvn_viz.layers.doors_layer import DoorsLayer
from ltvn_viz.layers.first_view import FirstView, Floor
from ltvn_viz.layers.graph_layers import BlockedEdgesLayer, EdgesLayer, NodesLayer
from ltvn_viz.layers.lights import add_lights
from ltvn_viz.layers.navigation_layers import GhostLayer, GoalLayer, PlanLayer
from ltvn_viz.layers.robot_layer import RobotLayer
from ltvn_viz.layers.scene_layer import AddedLayer, SceneLayer
from ltvn_viz.layers.trajectory_layer import CourseLayer, TrajectoryLayer
from ltvn_viz.painter import OwnParts, PagePart
from ltvn_viz.panels.camera_panel import CameraPanel
from ltvn_viz.panels.debugger_panel import DebuggerPanel
from ltvn_viz.panels.drive_panel import DrivePanel
from ltvn_viz.panels.fine_tuning_panel import FineTuningPanel
from ltvn_viz.panels.follow_camera import FollowCamera
from ltvn_viz.panels.html_widgets import grey_for_watchers
from ltvn_viz.panels.legend_panel import LegendPanel
from ltvn_viz.panels.navigation_panel import NavigationPanel
from ltvn_viz.panels.notifications import Notifications, OwnNotices
from ltvn_viz.panels.pad_panel import PadPanel
from ltvn_viz.panels.replay_panel import ReplayPanel
from ltvn_viz.panels.status_panel import StatusPanel
from ltvn_viz.panels.timeline_panel import TimelinePanel
from ltvn_viz.panels.world_panel import WorldPanel
from ltvn_viz.server.driver_seat import ClientId
from ltvn_viz.server.page_elements import shared_elements
from ltvn_viz.session.commands import AimBox, Command, PickNode, PutBox, ToggleDoor

TITLE = "Lifelong Topological Visual Navigation"


@dataclass(frozen=True, slots=True)
class PageAssets:
    """What is drawn from files."""

    scene_glb: Callable[[str, WorldState], bytes]
    """Loads the scene of a name as it is in a state of its world, ceiling cut away; raises SceneError."""
    robot_glb: bytes | None
    """The robot's body; None draws a plain one of its size."""
    robot: RobotSpec = LOCOBOT
    added_glb: Callable[[str, WorldState], bytes | None] = lambda _name, _state: None
    """Loads what stands in that scene for now; None where nothing does. Raises SceneError."""


class Pages(Protocol):
    """Who the pages are, and what they ask for."""

    def send(self, command: Command) -> None:
        """Ask for something from the driver's seat; the page's guard has seen to it."""
        ...

    def send_from(self, viser_client: int, command: Command) -> None:
        """Ask for something that a page without the seat may have in its own view."""
        ...

    def number_of(self, viser_client: int) -> ClientId | None:
        """Return our number of a page by viser's."""
        ...

    def file_address(self, address: str) -> str:
        """Return the address of a served file as a picture in a panel may have it."""
        ...

    def show_picture(self, jpeg: bytes) -> None:
        """Show all pages what the robot sees, colours beside depth."""
        ...

    def tell_moment(self, message: str) -> None:
        """Tell all pages which moment is on show."""
        ...

    def tell_activity(self, message: str) -> None:
        """Tell all pages what the robot does by itself."""
        ...


def build_layout(server: viser.ViserServer, pages: Pages, assets: PageAssets, floor: Floor) -> Sequence[PagePart]:
    """Put all layers and panels onto a page that begins with a view of a floor.

    Returns them in the order in which they should be drawn.
    """
    floor.begin(server)
    accent = (palette.ACCENT.red, palette.ACCENT.green, palette.ACCENT.blue)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=accent)
    server.gui.set_panel_label(TITLE)
    return [*_panels(server, pages, floor), *_layers(server.scene, pages, assets)]


def _panels(server: viser.ViserServer, pages: Pages, floor: Floor) -> list[PagePart]:
    gui, send = server.gui, pages.send

    def clients() -> list[viser.ClientHandle]:
        return list(server.get_clients().values())

    status = StatusPanel(gui)
    tabs = gui.add_tab_group()
    drive_tab = tabs.add_tab("Drive", viser.Icon.STEERING_WHEEL)
    with drive_tab:
        drive, learn = DrivePanel(gui), FineTuningPanel(gui)
    with tabs.add_tab("Go", viser.Icon.MAP_PIN):
        go = NavigationPanel(gui, send, pages.file_address)
    with tabs.add_tab("World", viser.Icon.DOOR):
        world = WorldPanel(gui)
    with tabs.add_tab("Replay", viser.Icon.HISTORY):
        replay = ReplayPanel(gui, send)
    why_tab = tabs.add_tab("Why", viser.Icon.ZOOM_QUESTION)
    gui.add_html(grey_for_watchers(shared_elements(gui)))
    camera = CameraPanel(gui, pages.show_picture)

    def own_parts(client: viser.ClientHandle) -> Sequence[PagePart]:
        view = FirstView(floor, server, client)
        with drive_tab:
            follow = FollowCamera(client.gui, lambda: [client])
        with why_tab:
            why = DebuggerPanel(client.gui, partial(pages.send_from, client.client_id))
        legend = LegendPanel(client.gui)
        return [view, follow, why, legend, DebuggerLayer(client.scene), OwnNotices(client)]

    own = OwnParts(clients, own_parts, pages.number_of)
    return [
        status,
        camera,
        drive,
        learn,
        go,
        world,
        replay,
        own,
        TimelinePanel(pages.tell_moment),
        PadPanel(pages.tell_activity),
        Notifications(clients),
    ]


def _layers(scene: viser.SceneApi, pages: Pages, assets: PageAssets) -> list[PagePart]:
    add_lights(scene)
    return [
        RobotLayer(scene, assets.robot, assets.robot_glb),
        SceneLayer(scene, assets.scene_glb),
        AddedLayer(scene, assets.added_glb),
        DoorsLayer(scene, on_pick=lambda door, client: pages.send_from(client, ToggleDoor(door))),
        BoxesLayer(
            scene,
            on_pick=lambda box, client: pages.send_from(client, AimBox(box)),
            on_floor=lambda place, client: pages.send_from(client, PutBox(place)),
        ),
        NodesLayer(scene, on_pick=lambda node, client: pages.send_from(client, PickNode(node))),
        BlockedEdgesLayer(scene),
        PlanLayer(scene),
        GoalLayer(scene),
        GhostLayer(scene, assets.robot),
        ChangesLayer(scene),
        CourseLayer(scene),
        TrajectoryLayer(scene),
        EdgesLayer(scene),
    ]
