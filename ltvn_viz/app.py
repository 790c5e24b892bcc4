"""The app's composition root: opens simulator, network, map and page, and puts them together.

Owns what is opened in which order, and that all of it is closed again. Owns no behaviour.
"""

import logging
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import FrameType

import numpy as np

from ltvn_core.composition import PredictorName, open_predictor, open_simulation
from ltvn_core.config import Method, preset
from ltvn_core.nav.events import GraphChanged
from ltvn_core.recording.maps import LoadedMap, check_fingerprint, load_map
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.sim.camera import EmbreeCamera
from ltvn_core.sim.locobot import locobot_glb
from ltvn_core.sim.scenes import load_scene
from ltvn_core.types import Intrinsics, Predictor
from ltvn_viz.actions import listener
from ltvn_viz.commands import OpenRecording
from ltvn_viz.feed import CameraFeed
from ltvn_viz.goals import Goals
from ltvn_viz.library import Library
from ltvn_viz.live import Live
from ltvn_viz.mapping import Mapping
from ltvn_viz.painter import Painter
from ltvn_viz.recorder import Recorder
from ltvn_viz.replay import Replay, timeline_of
from ltvn_viz.screen import Assets, furnish, look_from_above
from ltvn_viz.server import GuardedServer
from ltvn_viz.session import Session
from ltvn_viz.stage import Stage
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.timeline import Timeline
from ltvn_viz.worker import Worker

logger = logging.getLogger(__name__)

DEMO_MAP = Path("recordings/demo-map.rrd")
PERSONS_LENS = Intrinsics(width=320, height=240)


@dataclass(frozen=True)
class AppOptions:
    """What the app is to open."""

    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    scene: str = "demo"
    map: Path | None = None
    """Map to begin with; None takes the ready-made one in the demo scene, else an empty map."""
    recordings: Path = Path("recordings")
    """Folder for recordings."""
    predictor: PredictorName = "network"
    weights: Path | None = None
    """Weights instead of the shipped ones."""
    preset: str = "robust"
    seed: int = 0
    replay: str | None = None
    """Name of a recording in the folder to open at once."""


@dataclass(frozen=True)
class App:
    """A running page; `session.run()` gives it life."""

    server: GuardedServer
    session: Session


def run_app(options: AppOptions, say: Callable[[str], None]) -> None:
    """Serve the page until interrupted; `say` gets the lines a person needs to open it. Raises LtvnError."""
    with opened(options) as app:
        say(f"Open {app.server.url}")
        say(f"From another machine first run: ssh -L {app.server.port}:127.0.0.1:{app.server.port} THIS_MACHINE")
        with _stopped_by_signals(app.session.stop):
            app.session.run()


@contextmanager
def opened(options: AppOptions) -> Iterator[App]:
    """Open everything, in the order in which mistakes of the options show soonest, and close it again."""
    with ExitStack() as stack:
        library = Library(options.recordings)
        if options.replay is not None:
            library.path(options.replay)
        method = preset(options.preset)
        known = _map_of(options)
        scene_name = options.scene if known is None else known.meta.scene
        predictor = open_predictor(options.predictor, scene_name, options.weights)
        if known is not None:
            check_fingerprint(known.meta, predictor.fingerprint)
        server = stack.enter_context(GuardedServer(port=options.port))
        stage = _stage(stack, replace(options, scene=scene_name), method, predictor, known, library, server)
        yield stack.enter_context(_running(server, stage, options))


@contextmanager
def _running(server: GuardedServer, stage: Stage, options: AppOptions) -> Iterator[App]:
    scene = load_scene(stage.scene)
    vertices, _ = scene.collision_triangles()
    look_from_above(server.viser, vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0))
    painter: list[Painter] = []
    session = Session(stage, server.seat, lambda snapshot: painter[0].publish(snapshot))
    parts = furnish(server.viser, session.send, Assets(_scene_glb, locobot_glb()))
    painter.append(Painter(parts, server.viser.atomic))
    painter[0].start()
    server.listen(listener(session))
    if options.replay is not None:
        session.send(OpenRecording(options.replay))
    try:
        yield App(server, session)
    finally:
        painter[0].close()


def _stage(
    stack: ExitStack,
    options: AppOptions,
    method: Method,
    predictor: Predictor,
    known: LoadedMap | None,
    library: Library,
    server: GuardedServer,
) -> Stage:
    first_step = max(known.observations, default=-1) + 1 if known is not None else 0
    simulation = open_simulation(options.scene, seed=options.seed, first_step=first_step)
    stack.callback(simulation.robot.close)
    camera = EmbreeCamera(simulation.scene.surfaces, supersampling=1)
    feed = CameraFeed(lambda pose: camera.render(pose, PERSONS_LENS))
    stack.callback(feed.close)
    mapping = Mapping(predictor, method, np.random.default_rng(options.seed))
    worker = Worker(ThreadPoolExecutor(1, "map and model"))
    thumbnails = Thumbnails()
    server.add_route("/thumb/", thumbnails.get)

    def open_writer(path: Path) -> RecordingWriter:
        writer = RecordingWriter(
            path,
            scene=options.scene,
            config=asdict(method),
            fingerprint=predictor.fingerprint,
            scene_glb=simulation.scene.glb(with_ceiling=False),
        )
        if mapping.graph.nodes:
            writer.map(mapping.graph, mapping.kept())
        return writer

    live = Live(simulation.robot, Recorder(library, open_writer), Timeline())
    if known is not None:
        _load(live, mapping, known)
    return Stage(
        scene=options.scene,
        live=live,
        mapping=mapping,
        worker=worker,
        library=library,
        open_replay=lambda name: open_replay(library, name),
        feed=feed,
        goals=Goals(mapping, worker, thumbnails),
    )


def open_replay(library: Library, name: str) -> Replay:
    """Read a recording of the library for the page; raises RecordingError."""
    recording = Recording.open(library.path(name))
    poses = recording.poses
    drawn = poses.odometry if poses.exact is None else poses.exact
    frames = list(zip(poses.steps.tolist(), poses.stamps.tolist(), drawn, strict=True))
    return Replay(name, recording.meta.scene, timeline_of(frames, recording.events), recording)


def _map_of(options: AppOptions) -> LoadedMap | None:
    if options.map is not None:
        return load_map(options.map)
    if options.scene == "demo" and DEMO_MAP.exists():
        return load_map(DEMO_MAP)
    return None


def _load(live: Live, mapping: Mapping, known: LoadedMap) -> None:
    for frame, seen in known.observations.items():
        live.timeline.place(frame, seen.odometry if seen.exact_pose is None else seen.exact_pose)
    for delta in mapping.load(known.graph, list(known.observations.values())):
        live.emit(GraphChanged(delta))


@lru_cache(maxsize=4)
def _scene_glb(name: str) -> bytes:
    return load_scene(name).glb(with_ceiling=False)


@contextmanager
def _stopped_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Let Ctrl-C and a polite kill end the app in order, so that a recording is finished."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        stop()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
