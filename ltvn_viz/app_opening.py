"""Opening of everything behind a page that is already served: simulator, network, map, session, layers and panels.

Owns the order of opening for the options of the command line, and the choice of robot, world and first map. Takes
seconds to import.
"""

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.played_drive import PlayedDrive, open_robot
from ltvn_core.data.recording.demo_files import DEMO_MAP, demo_file
from ltvn_core.data.recording.map_file import LoadedMap, check_fingerprint, load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import OptionError, RecordingError, SceneError
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.maps.recorded_map import BuildOptions
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Severity
from ltvn_core.predictors.choice import AUTO, ImageSource
from ltvn_core.predictors.opening import NETWORK, open_method, simulated_robot
from ltvn_core.robots.robot import Robot, open_loop_word
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.locobot_model import locobot_glb
from ltvn_core.systems.maintenance import recorded_maintenance, with_maintenance
from ltvn_core.systems.registry import DEFAULT_SYSTEM, open_system, recorded_system
from ltvn_core.types import Pose, Predictor
from ltvn_viz.debugger.inspector import Inspector
from ltvn_viz.debugger.question_registry import all_questions
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.layers.scene_assets import floor_bounds
from ltvn_viz.page_layout import PageAssets, Painter, build_layout
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.session.activities.playback import ReplayMethods, open_replay
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.backend import Backend, live_robot, open_backend, open_larger_feed, predictor_for
from ltvn_viz.session.changeable_world import ChangeableWorld
from ltvn_viz.session.fine_tuning import FineTuning
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.goals import node_picture
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.live_run import LiveRobot, LiveRun
from ltvn_viz.session.options import DEMO_SCENE, AppOptions
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.session.recording_library import RecordingLibrary, RerunViewers
from ltvn_viz.session.robot_link import RobotLink
from ltvn_viz.session.saved_files import SAVED_ENDING, SAVED_PREFIX
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.share_links import question_commands
from ltvn_viz.session.worker import Worker
from ltvn_viz.timeline.run_moment import moment_of
from ltvn_viz.wishes.commands import OpenRecording

logger = logging.getLogger(__name__)


def open_app_state(options: AppOptions, stack: ExitStack, say: Callable[[str], None] = lambda _: None) -> AppState:
    """Open the parts that the options name, to be closed by `stack`; `say` gets the name of each slow step. Raises
    LtvnError.

    The options that a person may get wrong are checked first, and fast steps come before slow ones.
    """
    library = RecordingLibrary(options.recordings)
    if options.replay is not None:
        library.path(options.replay)
    if options.robot is not None:
        say("Connecting to the robot…")
    own_robot = _open_own_robot(options, stack)
    named = options.scene
    options = replace(options, scene=options.scene or (DEMO_SCENE if own_robot is None else own_robot.spec.name))
    chosen = None if options.map is None else load_map(options.map)
    if chosen is not None:
        _check_same_scene(named, chosen, own_robot)
        _check_same_system(options, chosen)
        options = replace(options, scene=chosen.meta.scene, system=recorded_system(chosen.meta.config).name)
    source = _image_source(options, library, own_robot, chosen)
    choice = (source or ImageSource(camera=LOCOBOT.camera)).choose(options.predictor)
    logger.info("Images are compared by %s.", choice)
    asked, options = options, replace(options, predictor=choice.name)
    camera = simulated_robot(choice.name).camera if source is None else source.camera
    say("Opening the network that compares images…")
    predictor = predictor_for(options, camera)
    system = _open_system(options, predictor)
    if chosen is not None:
        check_fingerprint(chosen.meta, predictor.fingerprint)
    say("Reading the map…")
    known = chosen or _ready_made(options, predictor)
    say("Starting the simulator…" if own_robot is None else "Preparing the robot…")
    backend = open_backend(options, known, stack) if own_robot is None else Backend(robot=own_robot)
    simulation = backend.simulation
    world_time = None if simulation is None else lambda: simulation.world.time_s
    live_map = LiveMap(TopologicalMap.of(predictor, system), np.random.default_rng(options.seed), world_time=world_time)
    worker = Worker(ThreadPoolExecutor(1, "map and model"))
    robot = live_robot(backend, predictor, known)
    recorder = Recorder(
        library,
        lambda path: _new_recording(path, options, backend, robot, live_map),
        take_map=live_map.copied,
        scene_glb=lambda: None if simulation is None else simulation.scene.glb(),
    )
    live = LiveRun(robot, recorder, Timeline())
    choose_method = (
        ReplayMethods(options, predictor).of if asked.predictor == AUTO else lambda _: None
    )  # The named one.
    state = AppState(
        scene=options.scene,
        live=live,
        live_map=live_map,
        worker=worker,
        library=library,
        open_replay=lambda name: open_replay(library, name, choose_method),
        larger_feed=open_larger_feed(backend, stack),
        fine_tuning=_open_learning(options),
        predictor_for=lambda weights: _reopen_with(options, weights, camera),
        debugger=Inspector(all_questions(live.breakpoint_monitor, options.questions), worker),
        rerun=RerunViewers(stack).address,
        alignment=None if options.floor_plan is None else FloorPlanClicks(options.floor_plan),
        link=_link(backend.robot),
        open_loop=open_loop_word(backend.robot),
        played=backend.robot if isinstance(backend.robot, PlayedDrive) else None,
        build_options=BuildOptions(
            preset=options.preset,
            system=options.system,
            predictor=asked.predictor,
            weights=options.weights,
            device=options.device,
            seed=options.seed,
        ),
    )
    if known is not None:
        logger.info("The map has %d nodes and %d edges.", len(known.graph.nodes), len(known.graph.edges))
        say(f"Computing the descriptors of {len(known.graph.nodes):,} nodes…")
        state.start_with(TopologicalMap.take(known, predictor, system), known.observations.values())
    if not backend.is_absent:
        live_map.keyframes.space = robot.spec.needed_space
    if simulation is not None:
        state.world = ChangeableWorld(simulation.world, live, simulation.robot.teleport)
        if simulation.scene.doubts and options.replay is None:
            state.say(" ".join(simulation.scene.doubts), Severity.WARN)
    return state


def _link(robot: Robot) -> RobotLink | None:
    ask = getattr(robot, "link_report", None)
    return None if ask is None else RobotLink(robot.spec.name, ask)


def _check_same_scene(named: str, chosen: LoadedMap, own_robot: Robot | None) -> None:
    """Raise OptionError if --scene names another scene than the map's, unless the user's own robot drives."""
    if not named or own_robot is not None or named == chosen.meta.scene:
        return
    if _scene_address(named) != _scene_address(chosen.meta.scene):
        raise OptionError(
            f"--scene {named} contradicts --map, which was made in {chosen.meta.scene}; leave --scene out, or name a "
            "map of that scene."
        )


def _check_same_system(options: AppOptions, chosen: LoadedMap) -> None:
    """Raise OptionError if --system names another system than the one that built the map."""
    own = recorded_system(chosen.meta.config).name
    if options.system not in (DEFAULT_SYSTEM, own):
        raise OptionError(
            f"--system {options.system} contradicts --map, which {own} built; leave --system out, or build a map with "
            f"`ltvn build RECORDING --system {options.system}`."
        )


def _scene_address(name: str) -> str:
    """Return the address that recordings use for a scene; an unknown name is returned unchanged."""
    from ltvn_core.simulation.scene_registry import load_scene, scene_names

    try:
        return name if name in scene_names() else load_scene(name).address
    except SceneError:
        return name


def _open_own_robot(options: AppOptions, stack: ExitStack) -> Robot | None:
    """Open the robot of the options; `stack` stops and closes it. Raises PluginError, OptionError."""
    if options.robot is None:
        return None
    if options.world is not None:
        raise OptionError("--world changes a simulated scene; omit it with your own robot.")
    if options.predictor == "oracle":
        raise OptionError("The oracle knows only simulated scenes; use another predictor with your own robot.")
    robot = open_robot(options.robot)
    if isinstance(robot, PlayedDrive):
        robot.wait()  # The session plays it as soon as somebody looks.
    stack.callback(getattr(robot, "close", robot.stop))
    return robot


def _open_learning(options: AppOptions) -> FineTuning:
    tuner = replace(options.tuner, system=options.system, device=options.device)
    executor = ThreadPoolExecutor(1, "learning")
    return FineTuning(tuner if options.predictor == NETWORK else None, options.start_weights, executor)


def _image_source(
    options: AppOptions, library: RecordingLibrary, own_robot: Robot | None, chosen: LoadedMap | None
) -> ImageSource | None:
    """Return the source of the images: the map's recording, the user's own robot, or the recording to watch.

    None means the simulator, whose camera is chosen to suit the predictor.
    """
    if chosen is not None:
        return ImageSource.of(chosen.meta)
    if own_robot is not None:
        return ImageSource(camera=own_robot.spec.camera)
    if options.replay is not None:
        with suppress(RecordingError):  # The code that opens it for the page reports the error.
            return ImageSource.of(Recording.open(library.path(options.replay)).meta)
    return None


def _open_system(options: AppOptions, predictor: Predictor) -> NavigationSystem:
    """Return the navigation system of the options with the predictor's constants. Raises OptionError, WeightsError."""
    system = open_system(options.system, open_method(options.preset, predictor))
    return system if options.maintenance is None else with_maintenance(system, options.maintenance)


def _reopen_with(options: AppOptions, weights: Path, camera: CameraModel) -> tuple[Predictor, NavigationSystem]:
    """Open other weights in the same way as a restart of the app with them."""
    changed = replace(options, weights=weights, replay=None)
    predictor = predictor_for(changed, camera)
    return predictor, _open_system(changed, predictor)


def _ready_made(options: AppOptions, predictor: Predictor) -> LoadedMap | None:
    """Return the ready-made map of the demo scene; None in other scenes, and if the weights or the system differ."""
    if options.scene != DEMO_SCENE or options.replay is not None or options.robot is not None:
        return None
    own = options.recordings / DEMO_MAP
    place = own if own.exists() else demo_file(DEMO_MAP)
    if place is None:
        return None
    known = load_map(place)
    if known.meta.fingerprint != predictor.fingerprint:
        logger.info("The ready-made map was built with other weights; starting with an empty map.")
        return None
    if recorded_system(known.meta.config).name != options.system:
        logger.info("The ready-made map is not of %s; starting with an empty map.", options.system)
        return None
    return known


def _new_recording(
    path: Path, options: AppOptions, backend: Backend, robot: LiveRobot, live_map: LiveMap
) -> RecordingWriter:
    """Begin a recording; never waits for the disk, because the robot does not wait either."""
    if backend.is_absent:
        raise SceneError("There is no robot to record; open the app with a scene.")
    scene = None if backend.simulation is None else backend.simulation.scene
    return RecordingWriter(
        path,
        scene=options.scene if scene is None else scene.address,
        config={
            "verb": "app",
            "system": live_map.system.name,
            "predictor": options.predictor,
            "method": asdict(live_map.system.method),
            "maintenance": recorded_maintenance(live_map.system),
            **({} if scene is None else {"body": choose_body(options.body)}),
            **robot.spec.needed_space.to_config(),
        },
        fingerprint=live_map.fingerprint,
        camera=robot.spec.camera,
        live_port=options.stream,
        patience_s=0,
    )


UNKNOWN_FLOOR_M = 4.0
"""Margin on each side of the robot in the first view of an unknown place, in metres."""

LEAST_FLOOR_M, ROUND_ABOUT_M = 1.0, 0.7
"""Least extent of the first view of a drive, and its margin on each side, in metres."""


def open_session(options: AppOptions, server: GuardedServer, stack: ExitStack) -> Session:
    """Open everything behind the page of a server, to be closed by `stack`, and draw it there. Raises LtvnError."""
    state = open_app_state(options, stack, server.say_loading)
    state.shows_camera = lambda: server.shown.camera
    server.say_loading("Building the panels…")
    robot = state.live.robot
    middle = np.nan_to_num(robot.drawn_pose[:2])
    around = middle - UNKNOWN_FLOOR_M, middle + UNKNOWN_FLOOR_M
    floor = floor_bounds(state.scene) or _driven_floor(state, options) or around
    assets = PageAssets(robot.spec, locobot_glb() if robot.spec.name == LOCOBOT.name else None)
    session = open_page(state, server, stack, Painter(server.viser.atomic), assets, Floor(*floor))
    if options.replay is not None:
        asked = question_commands(options.replay_question, session.state.debugger.words)
        session.send(OpenRecording(options.replay, options.replay_at_s, asked))
    return session


def open_page(
    state: AppState,
    server: GuardedServer,
    stack: ExitStack,
    painter: Painter,
    assets: PageAssets,
    floor: Floor,
) -> Session:
    """Join a session's state to the page of a server, drawn by `painter` and to be closed by `stack`."""
    server.add_route("/thumb/", state.goals.thumbnails.get)
    server.add_route("/seen/", lambda frame: node_picture(state.shown_observation, frame))
    server.add_route("/marks/", state.strips.rows_from, ending="json")
    server.add_route(SAVED_PREFIX, state.saved_files.read, ending=SAVED_ENDING)
    session = Session(
        state,
        server.seat,
        painter.publish,
        absence=lambda: server.presence.absence,
        is_seen=lambda: server.presence.is_somebody_there,
    )
    painter.start(*build_layout(server, session.send, assets, floor), lambda: server.shown.scene)
    stack.callback(painter.close)
    server.listen(session.listener)
    return session


def _driven_floor(state: AppState, options: AppOptions) -> tuple[Pose, Pose] | None:
    """Return two corners (x_m, y_m) around drive and map of the recording to watch; None if it cannot be read."""
    if options.replay is None:
        return None
    try:
        replay = state.open_replay(options.replay)
    except RecordingError:  # The code that opens it for the page reports the error.
        return None
    places = np.concatenate([replay.course, moment_of(replay.timeline).graph.poses])[:, :2]
    if not len(places):
        return None
    low = places.min(axis=0)
    high = places.max(axis=0)
    margin = max(0.0, LEAST_FLOOR_M - float((high - low).max())) / 2 + ROUND_ABOUT_M
    return low - margin, high + margin
