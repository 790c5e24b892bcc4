"""Sets the stage for the options of the command line: map, recordings, and who plays.

Owns the order in which things are opened, and which map is the first. Knows no page.
"""

import logging
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ltvn_core.composition import open_method
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError, SceneError
from ltvn_core.nav.events import GraphChanged
from ltvn_core.recording.collector import collector_paused
from ltvn_core.recording.maps import LoadedMap, check_fingerprint, load_map
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.types import Predictor
from ltvn_viz.absent import AbsentTeleop
from ltvn_viz.cast import Cast, open_body, open_mind
from ltvn_viz.goals import Goals
from ltvn_viz.learning import Learning
from ltvn_viz.library import Library
from ltvn_viz.live import Live
from ltvn_viz.mapping import Mapping
from ltvn_viz.options import DEMO_SCENE, AppOptions
from ltvn_viz.recorder import Recorder
from ltvn_viz.replay import Replay, timeline_of
from ltvn_viz.rerun_views import RerunViews
from ltvn_viz.stage import Stage
from ltvn_viz.teleop import Teleop
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.timeline import Timeline
from ltvn_viz.worker import Worker

logger = logging.getLogger(__name__)

DEMO_MAP = "demo-map.rrd"


def open_stage(options: AppOptions, stack: ExitStack, thumbnails: Thumbnails) -> Stage:
    """Open what the options name, to be closed by `stack`. Raises LtvnError.

    What a person can get wrong is looked at first, and cheap things before dear ones.
    """
    library = Library(options.recordings)
    if options.replay is not None:
        library.path(options.replay)
    method = open_method(options.preset, options.predictor, options.weights)
    chosen = None if options.map is None else load_map(options.map)
    if chosen is not None:
        options = replace(options, scene=chosen.meta.scene)
    predictor = open_mind(options)
    if chosen is not None:
        check_fingerprint(chosen.meta, predictor.fingerprint)
    known = chosen or _ready_made(options, predictor)
    cast = open_body(options, known, stack)
    mapping = Mapping(predictor, method, np.random.default_rng(options.seed))
    worker = Worker(ThreadPoolExecutor(1, "map and model"))
    recorder = Recorder(library, lambda path: _new_recording(path, cast, mapping, options.stream))
    live = Live(cast.robot, recorder, Timeline())
    if known is not None:
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
        learning=_open_learning(options),
        open_mind=lambda weights: _other_mind(options, weights),
        rerun=RerunViews(stack).address,
    )


def open_replay(library: Library, name: str) -> Replay:
    """Read a recording of the library for the page; raises RecordingError."""
    with collector_paused():
        recording = Recording.open(library.path(name))
        poses = recording.poses
        drawn = poses.odometry if poses.exact is None else poses.exact
        frames = list(zip(poses.steps.tolist(), poses.stamps.tolist(), drawn, strict=True))
        timeline = timeline_of(frames, recording.events)
    meta = recording.meta
    system = str(meta.config.get("system", ""))
    return Replay(name, meta.scene, timeline, recording, weights=meta.fingerprint, system=system)


def _open_learning(options: AppOptions) -> Learning:
    tuner = options.tuner if options.predictor == "network" else None
    return Learning(tuner, options.weights, ThreadPoolExecutor(1, "learning"))


def _other_mind(options: AppOptions, weights: Path) -> tuple[Predictor, Method]:
    """Open other weights just as a new start of the app with them would."""
    mind = replace(options, weights=weights, replay=None)
    return open_mind(mind), open_method(options.preset, options.predictor, weights)


def _ready_made(options: AppOptions, predictor: Predictor) -> LoadedMap | None:
    """Return the demo scene's map, None elsewhere and where other weights are in use."""
    if options.scene != DEMO_SCENE or options.replay is not None:
        return None
    shipped = Path(__file__).parents[1] / "recordings" / DEMO_MAP
    place = next((place for place in (options.recordings / DEMO_MAP, shipped) if place.exists()), None)
    if place is None:
        return None
    known = load_map(place)
    if known.meta.fingerprint != predictor.fingerprint:
        logger.info("The ready-made map belongs to other weights; beginning with an empty one.")
        return None
    return known


def _new_recording(path: Path, cast: Cast, mapping: Mapping, live_port: int | None) -> RecordingWriter:
    """Begin a recording that holds the map as it is, so that it needs no other file."""
    if cast.simulation is None:
        raise SceneError("There is no robot here whose driving could be recorded; open the app with a scene.")
    writer = RecordingWriter(
        path,
        scene=cast.simulation.scene.address,
        config={"verb": "app", "system": "ltvn", "method": asdict(mapping.method)},
        fingerprint=mapping.fingerprint,
        scene_glb=cast.simulation.scene.glb(with_ceiling=False),
        live_port=live_port,
    )
    try:
        if mapping.graph.nodes:
            writer.map(mapping.graph, mapping.kept())
    except LtvnError:
        writer.close()
        raise
    return writer


def _take_map(live: Live, mapping: Mapping, known: LoadedMap) -> None:
    for frame, seen in known.observations.items():
        live.timeline.place(frame, seen.odometry if seen.exact_pose is None else seen.exact_pose)
    for delta in mapping.load(known.graph, list(known.observations.values())):
        live.emit(GraphChanged(delta))
