"""`ltvn navigate`: drive by a saved map."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.cameras.rectification import rectified_camera
from ltvn_core.data.recording.recorded_run import RunDescription
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.worlds.world_truth import true_presence, true_rooms
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.opening import open_script, open_simulation
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.types import NodeId, Pose
from ltvn_core.verbs.jobs.headless_runner import HeadlessRunner
from ltvn_core.verbs.jobs.own_robot import navigate_with
from ltvn_core.verbs.jobs.stream import announce_stream
from ltvn_core.verbs.navigate import NavigateSummary, NavigateVerb
from ltvn_core.verbs.verb import Summary


def navigate(options: NavigateVerb) -> Summary:
    """Drive and maintain the map; raises MapError, OptionError, RecordingError, SceneError and WeightsError."""
    if options.queries < 1 or (options.goal is not None and options.queries > 1):
        raise OptionError(
            f"--queries must be 1 or more, and 1 where --goal names the only goal, got {options.queries}."
        )
    if options.robot is not None:
        return navigate_with(options, options.robot)
    return _drive(options)


def _goals(options: NavigateVerb, runner: HeadlessRunner, rng: np.random.Generator) -> Sequence[NodeId]:
    """Return the one given goal, or random nodes."""
    return runner.random_goals(options.queries, rng) if options.goal is None else [options.goal]


def _drive(options: NavigateVerb) -> NavigateSummary:
    """Open all parts, run the queries, and save the map if requested."""
    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    known = options.open_map()
    observation = known.keyframes.observation
    simulation = open_simulation(
        known.scene,
        seed=options.seed,
        first_step=max(known.keyframes.frames) + 1,
        start=_start(known, rng),
        spec=replace(LOCOBOT, camera=rectified_camera(LOCOBOT.camera, known.predictor.camera)),
        script=None if options.world is None else open_script(options.world, known.scene, seed=options.seed),
        body=options.body,
    )
    if options.maintenance is not None:
        truth = true_presence(simulation.world, observation)
        room_of = true_rooms(simulation.scene, observation)
        system = with_maintenance(known.system, options.maintenance, truth=truth, room_of=room_of)
        known = replace(known, system=system)
    run = RunDescription(
        scene=known.scene,
        config=options.settings(known) | {"body": choose_body(options.body)},
        fingerprint=known.predictor.fingerprint,
        camera=simulation.robot.spec.camera,
        scene_glb=simulation.scene.glb(),
    )
    with run.open_writer(options.recording, live_port=announce_stream(options.stream)) as writer:
        writer.write_map(known.graph, known.observations)
        runner = HeadlessRunner(simulation, writer, known)
        outcome = runner.run_queries(_goals(options, runner, rng), rng)
    return options.finish(known, run, outcome, time.monotonic() - started)


def _start(known: TopologicalMap, rng: np.random.Generator) -> Pose | None:
    """Return the pose of a random node's image; None for a random free place, if the pose is unknown."""
    return known.keyframes.observation(int(rng.choice(list(known.graph.nodes)))).exact_pose
