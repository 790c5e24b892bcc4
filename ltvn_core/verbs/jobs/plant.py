"""`ltvn plant`: faults in a good map, and queries that meet them, for practice with the debugger and for its tests."""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.composition import open_method, open_predictor, open_simulation
from ltvn_core.config import Method
from ltvn_core.errors import MapError, OptionError
from ltvn_core.evaluation.fault_injection import Fault, missing_edge, perceptual_alias, spurious_edges
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import Cause, FramesReleased
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.recording.map_file import LoadedMap, check_fingerprint, load_map
from ltvn_core.recording.run_description import RunDescription
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.systems.registry import recorded_system
from ltvn_core.types import Predictor
from ltvn_core.verbs.jobs.headless_runner import HeadlessRunner, QueriesSummary
from ltvn_core.verbs.plant import PlantVerb
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True)
class PlantSummary:
    """What was planted, and what became of the queries that met it."""

    recording: Path
    faults: tuple[Fault, ...]
    """One for each query of a round."""
    nodes: int
    edges: int
    outcome: QueriesSummary
    pruned_spurious: int
    """How many of the edges that were pruned are spurious by the truth."""
    wall_s: float


def plant_faults(options: PlantVerb) -> Summary:
    """Plant, drive and record; raises OptionError, MapError, RecordingError, SceneError and WeightsError."""
    if options.steps < 1:
        raise OptionError(f"--steps must be 1 or more, got {options.steps}.")
    if options.edges < 1 or options.rounds < 1:
        raise OptionError(f"--edges and --rounds must be 1 or more, got {options.edges} and {options.rounds}.")
    return _drive(options)


def _drive(options: PlantVerb) -> PlantSummary:
    started, loaded, rng = time.monotonic(), load_map(options.map), np.random.default_rng(options.seed)
    entry = recorded_system(loaded.meta.config)
    meta = loaded.meta
    choice = ImageSource.of(meta).choose(options.predictor)
    weights = entry.weights_for(choice.name, options.weights)
    predictor = open_predictor(choice.name, meta.scene, weights, camera=meta.camera)
    system = _system(options, entry.factory(_method(options, predictor)))
    check_fingerprint(meta, predictor.fingerprint)
    keyframes, graph = KeyframeStore(predictor), loaded.graph
    if len(graph.nodes) < 2:
        raise MapError(f"{options.map} has one node; faults lie between nodes, so choose a larger map.")
    keyframes.begin_drives(graph.drives)
    keyframes.add([loaded.observations[frame] for frame in graph.frames if frame not in graph.reserve])
    truth = GroundTruth(load_scene(meta.scene).clearance, lambda node: loaded.observations[node])
    faults = tuple(_insert_faults(options, loaded, truth, keyframes, predictor, system.method))
    spurious = truth.spurious(graph)
    start, first_step = loaded.observations[faults[0].start].exact_pose, max(loaded.observations) + 1
    simulation = open_simulation(
        loaded.meta.scene, seed=options.seed, first_step=first_step, start=start, body=options.body
    )
    run = RunDescription(
        scene=meta.scene,
        config=_settings(options, system, faults) | {"predictor": choice.name, "body": choose_body(options.body)},
        fingerprint=predictor.fingerprint,
        scene_glb=simulation.scene.glb(),
    )
    with run.open_writer(options.recording) as writer:
        writer.write_map(graph, [loaded.observations[frame] for frame in graph.frames])
        runner = HeadlessRunner(simulation, writer, keyframes, predictor, system, graph)
        queries = faults * options.rounds
        outcome = runner.run_queries([fault.goal for fault in queries], rng, starts=[fault.start for fault in queries])
    return PlantSummary(
        recording=options.recording,
        faults=faults,
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        outcome=outcome,
        pruned_spurious=len(spurious - graph.edges.keys()),
        wall_s=time.monotonic() - started,
    )


def _method(options: PlantVerb, predictor: Predictor) -> Method:
    """Return the robust preset, which gives up early."""
    method = open_method("robust", predictor)
    short = replace(method.recovering, step_limit=options.steps, give_up_after_looks=12)
    return replace(method, recovering=short)


def _system(options: PlantVerb, system: NavigationSystem) -> NavigationSystem:
    """Return the system with the maintenance that is asked for."""
    return system if options.maintenance is None else with_maintenance(system, options.maintenance)


def _insert_faults(
    options: PlantVerb,
    loaded: LoadedMap,
    truth: GroundTruth,
    keyframes: KeyframeStore,
    predictor: Predictor,
    method: Method,
) -> Iterator[Fault]:
    """Put the faults into the map; cut first, so that no other fault joins what is cut."""
    graph, near = loaded.graph, method.building.connect_distance
    graph.apply(FramesReleased(tuple(graph.reserve), Cause.LOAD))
    plant = {
        "missing-edge": lambda: (missing_edge(graph, truth),),
        "spurious-edge": lambda: spurious_edges(graph, truth, method.believing, options.edges),
        "look-alike": lambda: (perceptual_alias(graph, truth, keyframes, predictor, method.believing, near),),
    }
    faults: dict[str, tuple[Fault, ...]] = {}
    for kind in (kind for kind in plant if kind in options.kinds):
        faults[kind] = plant[kind]()
        for fault in faults[kind]:
            _apply_fault(graph, fault)
    return (fault for kind in options.kinds for fault in faults[kind])


def _apply_fault(graph: TopologicalGraph, fault: Fault) -> None:
    for delta in fault.deltas:
        graph.apply(delta)


def _settings(options: PlantVerb, system: NavigationSystem, faults: tuple[Fault, ...]) -> dict[str, Any]:
    """Say how the recording was made, and what is to be found in it."""
    said = [
        {"kind": fault.kind, "query": query, "start": fault.start, "goal": fault.goal, "edges": fault.edges}
        for query, fault in enumerate(faults * options.rounds)
    ]
    return {
        "verb": "plant",
        "maintenance": options.maintenance,
        "system": system.name,
        "seed": options.seed,
        "method": asdict(system.method),
        "faults": said,
    }
