"""The composition root of the pair viewer: shards, network, guarded server, panel and scene, and their loop.

Callbacks of the page only enqueue commands, and the loop runs them one after another. Owns the scene: a pair from
above, with both cameras, and the points that each camera sees in the camera's colour. The scene is drawn in the frame
of the source, which looks upwards on the screen. So pairs with the same waypoint always look the same, wherever they
are in the apartment.
"""

import queue
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser
import viser.transforms as vt

from ltvn_core import palette
from ltvn_core.errors import LtvnError
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.training_data.pair_table import unproject
from ltvn_core.palette import Rgb8
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Depth, Waypoint
from ltvn_viz.layers.shapes import LineSegments, marker_mesh, points, wxyz
from ltvn_viz.pairs.pair_browser import PairBrowser, PairCommand, ShownPair, scenes_in
from ltvn_viz.pairs.pair_panel import PairPanel
from ltvn_viz.server.guarded_server import GuardedServer, stop_on_signals

CUT_M = 1.9
"""Height limit in metres; higher points would hide the floor from above."""
POINT_STEP = 3
"""Every third point is drawn, which is enough to recognise the scene, and fast on a page without a GPU."""
_RULED_M = 6
_CAMERA = LOCOBOT.camera
_CAMERA_TO_ROBOT = vt.SO3.from_matrix(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
"""Rotation from the camera's axes (right, down, ahead) to the robot's (ahead, left, up)."""


class PairScene:
    """Source, target and prediction in 3D."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Add all hidden nodes and look straight down."""
        scene = server.scene
        scene.configure_default_lights(cast_shadow=False)
        scene.configure_environment_map("warehouse", environment_intensity=0.35)
        server.initial_camera.look_at = (1.35, 0.0, 0.0)
        server.initial_camera.position = (0.75, 0.0, 5.2)
        # Plain squares of one metre: viser's own grid shades every pixel, which is slow without a GPU.
        _ruled(scene)
        self._source = _Camera(scene, "/source", palette.SOURCE)
        self._target = _Camera(scene, "/target", palette.TARGET)
        self._predicted = _arrow(scene, "/predicted", palette.PREDICTED_POSE, length_m=0.17, height_m=0.72)

    def show(self, shown_pair: ShownPair) -> None:
        """Draw a pair."""
        pair = shown_pair.pair
        self._predicted.visible = pair is not None
        if pair is None:
            self._source.hide()
            self._target.hide()
            return
        self._source.place(np.zeros(3), pair.source_depth)
        self._target.place(pair.waypoint, pair.target_depth)
        self._predicted.position = points(shown_pair.waypoint, 0.0)
        self._predicted.wxyz = wxyz(shown_pair.waypoint[2])


class _Camera:
    """An arrow at the robot's pose, the frustum of its camera, and the points that the camera sees."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb8) -> None:
        self._arrow = _arrow(scene, name, colour, length_m=0.3, height_m=0.66)
        fov = _CAMERA.vertical_fov_rad
        scene.add_camera_frustum(
            f"{name}/camera",
            float(fov),
            _CAMERA.width / _CAMERA.height,
            scale=0.5,
            thickness=0.02,
            color=colour,
            wxyz=_CAMERA_TO_ROBOT.wxyz,
            position=(0.0, 0.0, _CAMERA.height_m),
            cast_shadow=False,
            receive_shadow=False,
        )
        self._points = scene.add_point_cloud(
            f"{name}/points", np.zeros((1, 3)), colour, point_size=0.022, point_shape="square", point_shading="flat"
        )

    def hide(self) -> None:
        self._arrow.visible = False

    def place(self, pose: Waypoint, depth: Depth) -> None:
        self._arrow.visible = True
        self._arrow.position = points(pose, 0.0)
        self._arrow.wxyz = wxyz(pose[2])
        seen = unproject(depth)[::POINT_STEP]
        self._points.points = seen[seen[:, 2] < CUT_M]


def _ruled(scene: viser.SceneApi) -> None:
    marks = np.arange(-_RULED_M, _RULED_M + 1)
    low = np.full_like(marks, -_RULED_M)
    high = np.full_like(marks, _RULED_M)
    along = np.stack([np.column_stack([marks, low]), np.column_stack([marks, high])], axis=1)
    segments = points(np.concatenate([along, along[..., ::-1]]), 0.0)
    LineSegments(scene, "/floor", thickness_px=1.0).draw(segments, np.full((len(segments), 3), (52, 57, 69), np.uint8))


def _arrow(scene: viser.SceneApi, name: str, colour: Rgb8, *, length_m: float, height_m: float) -> viser.FrameHandle:
    frame = scene.add_frame(name, show_axes=False, visible=False)
    vertices, faces = marker_mesh(length_m, 0.02)
    scene.add_mesh_simple(
        f"{name}/arrow",
        vertices,
        faces,
        color=colour,
        position=(0.0, 0.0, height_m),
        cast_shadow=False,
        receive_shadow=False,
    )
    return frame


PANEL_PX = 520
TITLE = "Labelled pairs"


@dataclass(frozen=True)
class PairsOptions:
    """Options of the pair viewer."""

    folder: Path
    port: int = 8080
    weights: Path | None = None
    """Weights of the network; None takes the shipped ones."""


class PairsApp:
    """A page that is served; `run` runs its loop."""

    def __init__(self, server: GuardedServer, browser: PairBrowser) -> None:
        """Add the content of the page and show the first pair."""
        self.server = server
        self._browser = browser
        self._commands: queue.SimpleQueue[PairCommand | None] = queue.SimpleQueue()
        gui = server.gui
        accent = (palette.ACCENT.red, palette.ACCENT.green, palette.ACCENT.blue)
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=accent)
        gui.set_panel_label(TITLE)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        self._panel = PairPanel(gui, browser.scenes, self._commands.put)
        self._space = PairScene(server.viser)
        self._show()

    def run(self) -> None:
        """Run commands until `stop` is called."""
        while (command := self._commands.get()) is not None:
            if self._browser.is_slow(command):
                self._panel.show_busy("Asking the network about every pair of this scene…")
            try:
                self._browser.handle(command)
            except LtvnError as error:
                self._panel.show_error(str(error))
            else:
                self._show()

    def stop(self) -> None:
        """End `run`. May be called from any thread and from a signal handler."""
        self._commands.put(None)

    def _show(self) -> None:
        shown_pair = self._browser.shown_pair()
        with self.server.viser.atomic():
            self._panel.show(shown_pair)
            self._space.show(shown_pair)


@contextmanager
def open_pairs_app(options: PairsOptions) -> Iterator[PairsApp]:
    """Serve the viewer; raises DatasetError, WeightsError and ServerError before anything is served."""
    browser = PairBrowser(scenes_in(options.folder), load_predictor(options.weights))
    with GuardedServer(port=options.port, drives=False) as server:
        yield PairsApp(server, browser)


def run_pairs_app(options: PairsOptions, say: Callable[[str], None]) -> None:
    """Serve the viewer until interrupted; `say` gets the lines that tell a person how to open it. Raises LtvnError."""
    with open_pairs_app(options) as app, stop_on_signals(app.stop):
        port = app.server.port
        say(f"Open {app.server.url}")
        say(f"From another machine, first: ssh -L {port}:127.0.0.1:{port} THIS_MACHINE")
        app.run()
