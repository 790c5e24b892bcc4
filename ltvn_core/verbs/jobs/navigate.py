"""`ltvn navigate`: drive by a saved map."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.cameras.rectification import rectified_camera
from ltvn_core.composition import open_script, open_simulation
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.open_edges import true_presence
from ltvn_core.evaluation.true_rooms import true_rooms
from ltvn_core.recording.map_file import LoadedMap
from ltvn_core.recording.run_description import RunDescription
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.types import NodeId, Pose
from ltvn_core.verbs.jobs.headless_runner import HeadlessRunner
from ltvn_core.verbs.jobs.own_robot import navigate_with
from ltvn_core.verbs.jobs.stream import announce_stream
from ltvn_core.verbs.navigate import NavigateVerb
from ltvn_core.verbs.navigate_options import NavigateSummary
from ltvn_core.verbs.verb import Summary


def navigate(options: NavigateVerb) -> Summary:
    """Drive and learn; raises MapError, OptionError, RecordingError, SceneError and WeightsError."""
    if options.queries < 1 or (options.goal is not None and options.queries > 1):
        raise OptionError(
            f"--queries must be 1 or more, and 1 where --goal names the only goal, got {options.queries}."
        )
    if options.robot is not None:
        return navigate_with(options, options.robot)
    return _drive(options)


def _goals(options: NavigateVerb, runner: HeadlessRunner, rng: np.random.Generator) -> Sequence[NodeId]:
    """Go to the one goal, or to random nodes."""
    return runner.random_goals(options.queries, rng) if options.goal is None else [options.goal]


def _drive(options: NavigateVerb) -> NavigateSummary:
    """Open everything, run the queries, save the map if asked to."""
    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    opened = options.open_map()
    loaded, predictor, predictor_name, system, keyframes = opened
    meta = loaded.meta
    simulation = open_simulation(
        meta.scene,
        seed=options.seed,
        first_step=max(loaded.observations) + 1,
        start=_start(loaded, rng),
        spec=replace(LOCOBOT, camera=rectified_camera(LOCOBOT.camera, predictor.camera)),
        script=None if options.world is None else open_script(options.world, meta.scene, seed=options.seed),
        body=options.body,
    )
    if options.maintenance is not None:
        truth = true_presence(simulation.world, keyframes.observation)
        room_of = true_rooms(simulation.scene, keyframes.observation)
        system = with_maintenance(system, options.maintenance, truth=truth, room_of=room_of)
    run = RunDescription(
        scene=meta.scene,
        config=options.settings(system, predictor_name) | {"body": choose_body(options.body)},
        fingerprint=predictor.fingerprint,
        camera=simulation.robot.spec.camera,
        scene_glb=simulation.scene.glb(),
    )
    with run.open_writer(options.recording, live_port=announce_stream(options.stream)) as writer:
        writer.write_map(loaded.graph, loaded.observations.values())
        runner = HeadlessRunner(simulation, writer, keyframes, predictor, system, loaded.graph)
        outcome = runner.run_queries(_goals(options, runner, rng), rng)
    return options.finish(opened, run, outcome, time.monotonic() - started)


def _start(loaded: LoadedMap, rng: np.random.Generator) -> Pose | None:
    """Return where a random node's image was taken; None, a free place, if nobody knows."""
    return loaded.observations[int(rng.choice(list(loaded.graph.nodes)))].exact_pose
