"""Who plays on the stage: robot, network and map for the options of the command line.

Owns the choice of scene and map, and what stands in for a simulator or a network that is missing while a recording is
only to be watched. Knows no page.
"""

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ltvn_core.composition import START_CLEARANCE_M, PredictorName, Simulation, open_predictor, open_simulation
from ltvn_core.config import Method, preset
from ltvn_core.errors import LtvnError, SceneError, WeightsError
from ltvn_core.nav.events import GraphChanged
from ltvn_core.recording.maps import LoadedMap, check_fingerprint, load_map
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.sim.camera import EmbreeCamera
from ltvn_core.sim.drawing_mesh import to_glb
from ltvn_core.sim.scenes import Scene, load_scene
from ltvn_core.types import Intrinsics, Pose, Predictor
from ltvn_viz.absent import AbsentFeed, AbsentPredictor, AbsentRobot, AbsentTeleop
from ltvn_viz.cutaway import cut_away
from ltvn_viz.feed import CameraFeed
from ltvn_viz.goals import Goals
from ltvn_viz.library import Library
from ltvn_viz.live import Live, LiveRobot
from ltvn_viz.mapping import Mapping
from ltvn_viz.recorder import Recorder
from ltvn_viz.replay import Replay, timeline_of
from ltvn_viz.stage import Feed, Stage
from ltvn_viz.teleop import Teleop
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.timeline import Timeline
from ltvn_viz.worker import Worker

DEMO_SCENE = "demo"
DEMO_MAP = "demo-map.rrd"
START_CANDIDATES = 16
PERSONS_LENS = Intrinsics(width=320, height=240)


@dataclass(frozen=True)
class AppOptions:
    """What the app is to open."""

    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    scene: str = DEMO_SCENE
    """Scene to drive in; a map brings its own."""
    map: Path | None = None
    """Map to begin with; None takes the ready-made one in the demo scene, else an empty one."""
    recordings: Path = Path("recordings")
    """Folder for recordings."""
    predictor: PredictorName = "network"
    weights: Path | None = None
    """Weights instead of the shipped ones."""
    preset: str = "robust"
    """Name of the method's settings."""
    seed: int = 0
    """Draws the robot's start and its odometry noise."""
    replay: str | None = None
    """Name of a recording in the folder to open at once; then simulator and network may be missing."""


@dataclass(frozen=True)
class _Cast:
    """What drives and compares."""

    robot: LiveRobot
    predictor: Predictor
    feed: Feed
    simulation: Simulation | None


def open_stage(options: AppOptions, stack: ExitStack, thumbnails: Thumbnails) -> Stage:
    """Open what the options name, to be closed by `stack`. Raises LtvnError.

    What a person can get wrong is looked at first, and cheap things before dear ones.
    """
    library = Library(options.recordings)
    if options.replay is not None:
        library.path(options.replay)
    method = preset(options.preset)
    known = _map_of(options)
    if known is not None:
        options = replace(options, scene=known.meta.scene)
    cast = _cast(options, stack, known)
    mapping = Mapping(cast.predictor, method, np.random.default_rng(options.seed))
    worker = Worker(ThreadPoolExecutor(1, "map and model"))
    recorder = Recorder(library, lambda path: _new_recording(path, options, method, cast, mapping))
    live = Live(cast.robot, recorder, Timeline())
    if known is not None:
        check_fingerprint(known.meta, cast.predictor.fingerprint)
        _take_map(live, mapping, known)
    teleop = AbsentTeleop if cast.simulation is None else Teleop
    return Stage(
        scene=options.scene,
        live=live,
        mapping=mapping,
        worker=worker,
        library=library,
        open_replay=lambda name: open_replay(library, name),
        feed=cast.feed,
        goals=Goals(mapping, worker, thumbnails),
        teleop=teleop(live, worker, mapping.offer),
    )


def open_replay(library: Library, name: str) -> Replay:
    """Read a recording of the library for the page; raises RecordingError."""
    recording = Recording.open(library.path(name))
    poses = recording.poses
    drawn = poses.odometry if poses.exact is None else poses.exact
    frames = list(zip(poses.steps.tolist(), poses.stamps.tolist(), drawn, strict=True))
    return Replay(name, recording.meta.scene, timeline_of(frames, recording.events), recording)


@lru_cache(maxsize=4)
def scene_glb(name: str) -> bytes:
    """Return a scene for drawing, cut open; raises SceneError for an unknown one."""
    return to_glb(cut_away(load_scene(name).surfaces))


def floor_of(scene: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the low and the high corner (x_m, y_m) of a scene, None for an unknown one."""
    try:
        vertices, _ = load_scene(scene).collision_triangles()
    except SceneError:
        return None
    return vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)


def _cast(options: AppOptions, stack: ExitStack, known: LoadedMap | None) -> _Cast:
    try:
        predictor = open_predictor(options.predictor, options.scene, options.weights)
        scene = load_scene(options.scene)
        camera = EmbreeCamera(scene.surfaces, supersampling=1)
        start = _start(scene, camera, known, np.random.default_rng(options.seed))
        first_step = 0 if known is None else max(known.observations) + 1
        simulation = open_simulation(options.scene, seed=options.seed, first_step=first_step, start=start)
    except (SceneError, WeightsError) as missing:
        if options.replay is None:
            raise
        return _Cast(AbsentRobot(missing), AbsentPredictor(missing), AbsentFeed(), None)
    stack.callback(simulation.robot.close)
    feed = CameraFeed(lambda pose: camera.render(pose, PERSONS_LENS))
    stack.callback(feed.close)
    return _Cast(simulation.robot, predictor, feed, simulation)


def _start(scene: Scene, camera: EmbreeCamera, known: LoadedMap | None, rng: np.random.Generator) -> Pose:
    """Draw a place, on the map if there is one, from which there is something to see: nobody likes to face a wall."""
    candidates = scene.clearance.sample_poses(rng, START_CANDIDATES, min_clearance_m=START_CLEARANCE_M)
    if known is not None:
        poses = [known.observations[node].exact_pose for node in known.graph.nodes]
        mapped = np.array([pose for pose in poses if pose is not None]).reshape(-1, 3)
        mapped = mapped[scene.clearance.at(mapped[:, :2]) >= START_CLEARANCE_M]
        candidates = rng.permutation(mapped)[:START_CANDIDATES] if len(mapped) else candidates
    depths = [float(np.median(camera.render(pose, Intrinsics())[1])) for pose in candidates]
    return candidates[int(np.argmax(depths))]


def _new_recording(path: Path, options: AppOptions, method: Method, cast: _Cast, mapping: Mapping) -> RecordingWriter:
    """Begin a recording that holds the map as it is, so that it needs no other file."""
    if cast.simulation is None:
        raise SceneError("There is no robot here whose driving could be recorded; open the app with a scene.")
    writer = RecordingWriter(
        path,
        scene=options.scene,
        config=asdict(method),
        fingerprint=cast.predictor.fingerprint,
        scene_glb=cast.simulation.scene.glb(with_ceiling=False),
    )
    try:
        if mapping.graph.nodes:
            writer.map(mapping.graph, mapping.kept())
    except LtvnError:
        writer.close()
        raise
    return writer


def _map_of(options: AppOptions) -> LoadedMap | None:
    if options.map is not None:
        return load_map(options.map)
    if options.scene != DEMO_SCENE or options.replay is not None:
        return None
    shipped = Path(__file__).parents[1] / "recordings" / DEMO_MAP
    found = next((place for place in (options.recordings / DEMO_MAP, shipped) if place.exists()), None)
    return None if found is None else load_map(found)


def _take_map(live: Live, mapping: Mapping, known: LoadedMap) -> None:
    for frame, seen in known.observations.items():
        live.timeline.place(frame, seen.odometry if seen.exact_pose is None else seen.exact_pose)
    for delta in mapping.load(known.graph, list(known.observations.values())):
        live.emit(GraphChanged(delta))
