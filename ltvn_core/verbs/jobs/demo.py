"""The whole main job without a browser: collect, build, navigate with maintenance, record. Part of `ltvn demo`."""

import time
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.atomic_files import require_new_path
from ltvn_core.errors import OptionError
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.predictors.opening import open_method, open_predictor, simulated_robot
from ltvn_core.recording.run_description import RunDescription
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.systems.registry import DEFAULT_SYSTEM, open_system
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.verbs.demo import HeadlessDemoVerb
from ltvn_core.verbs.jobs.headless_runner import HeadlessRunner, QueriesSummary
from ltvn_core.verbs.jobs.story_demo import StoryOptions, run_story
from ltvn_core.verbs.jobs.stream import announce_stream
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True, kw_only=True)
class DemoSummary(QueriesSummary):
    """What happened, in numbers."""

    recording: Path
    map: Path | None
    """The map after all queries, if it was asked for."""
    frames: int
    """Images of the mapping tour."""
    nodes: int
    """In the map at the end."""
    edges: int
    predictor: str
    preset: str
    scene: str
    seed: int
    wall_s: float


def run_demo(options: HeadlessDemoVerb) -> Summary:
    """Do the job; raises OptionError, SceneError, RecordingError, MapError and WeightsError."""
    if options.queries < 0 or options.loops < 1:
        raise OptionError(
            f"--queries must be 0 or more and --loops 1 or more, got {options.queries} and {options.loops}."
        )
    if not options.story:
        return _run_headless(options)
    return run_story(
        StoryOptions(
            scene=options.scene,
            seed=options.seed,
            loops=options.loops,
            predictor=options.predictor,
            weights=options.weights,
            preset=options.preset,
            recording=options.recording or _dated_path(f"story-{Path(options.scene).stem}-{options.seed}"),
            stream=options.stream,
            body=options.body,
            settings=partial(_settings, options),
        )
    )


def _settings(options: HeadlessDemoVerb, system: NavigationSystem, predictor: str) -> dict[str, Any]:
    """Say how the run was made, for the recording."""
    return {
        "verb": "demo",
        "system": system.name,
        "predictor": predictor,
        "seed": options.seed,
        "loops": options.loops,
        "body": choose_body(options.body),
        "method": asdict(system.method),
    }


def _dated_path(name: str) -> Path:
    return Path("runs") / time.strftime(f"{name}-%Y%m%d-%H%M%S.rrd")


def _run_headless(options: HeadlessDemoVerb) -> DemoSummary:
    if options.map is not None:
        require_new_path(options.map)
    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    choice = ImageSource(camera=LOCOBOT.camera).choose(options.predictor)
    simulation = open_simulation(options.scene, seed=options.seed, spec=simulated_robot(choice.name), body=options.body)
    camera = simulation.robot.spec.camera
    predictor = open_predictor(choice.name, options.scene, options.weights, camera=camera)
    system = open_system(DEFAULT_SYSTEM, open_method(options.preset, predictor))
    path = options.recording or _dated_path(f"demo-{simulation.scene.name}-{options.seed}")
    run = RunDescription(
        scene=simulation.scene.address,
        config=_settings(options, system, choice.name),
        fingerprint=predictor.fingerprint,
        camera=camera,
        scene_glb=simulation.scene.glb(),
    )
    with run.open_writer(path, live_port=announce_stream(options.stream)) as writer:
        runner = HeadlessRunner(simulation, writer, TopologicalMap.of(predictor, system))
        observations = runner.collect(rng, options.loops)
        runner.build(observations, rng)
        outcome = runner.run_queries(runner.random_goals(options.queries, rng), rng)
    if options.map is not None:
        run.save_map(options.map, runner.map.graph, runner.map.observations)
    return DemoSummary(
        recording=path,
        map=options.map,
        frames=len(observations),
        nodes=len(runner.map.graph.nodes),
        edges=len(runner.map.graph.edges),
        **vars(outcome),
        predictor=choice.name,
        preset=options.preset,
        scene=simulation.scene.name,
        seed=options.seed,
        wall_s=time.monotonic() - started,
    )
