"""`ltvn plant`: puts faults into a good map, and runs queries that meet them, to practise with the debugger and to test
it."""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.data.recording.map_file import LoadedMap, load_map
from ltvn_core.data.recording.recorded_run import RunDescription
from ltvn_core.errors import MapError, OptionError
from ltvn_core.evaluation.fault_injection import Fault, missing_edge, perceptual_alias, spurious_edges
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import Cause, FramesReleased
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.predictors.opening import open_method
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.systems.registry import recorded_system
from ltvn_core.types import Predictor
from ltvn_core.verbs.jobs.headless_runner import HeadlessRunner
from ltvn_core.verbs.jobs.robot_queries import QueriesSummary
from ltvn_core.verbs.plant import PlantVerb
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True)
class PlantSummary:
    """Planted faults, and the results of the queries that met them."""

    recording: Path
    faults: tuple[Fault, ...]
    """The faults, one for each query of a round."""
    nodes: int
    edges: int
    outcome: QueriesSummary
    pruned_spurious: int
    """Number of pruned edges that are spurious by the ground truth."""
    wall_s: float


def plant_faults(options: PlantVerb) -> Summary:
    """Insert the faults, drive and record; raises OptionError, MapError, RecordingError, SceneError and
    WeightsError."""
    if options.steps < 1:
        raise OptionError(f"--steps must be 1 or more, got {options.steps}.")
    if options.edges < 1 or options.rounds < 1:
        raise OptionError(f"--edges and --rounds must be 1 or more, got {options.edges} and {options.rounds}.")
    return _drive(options)


def _drive(options: PlantVerb) -> PlantSummary:
    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    loaded = load_map(options.map)
    graph = loaded.graph
    if len(graph.nodes) < 2:
        raise MapError(f"{options.map} has one node, but faults join nodes; choose a larger map.")
    opened = TopologicalMap.open(loaded, predictor=options.predictor, weights=options.weights, with_reserve=False)
    known = replace(opened, system=_system(options, opened.predictor, loaded))
    truth = GroundTruth(load_scene(known.scene).clearance, lambda node: loaded.observations[node])
    faults = tuple(_insert_faults(options, known, truth))
    spurious = truth.spurious(graph)
    start = loaded.observations[faults[0].start].exact_pose
    first_step = max(loaded.observations) + 1
    simulation = open_simulation(known.scene, seed=options.seed, first_step=first_step, start=start, body=options.body)
    run = RunDescription(
        scene=known.scene,
        config=_settings(options, known, faults) | {"body": choose_body(options.body)},
        fingerprint=known.predictor.fingerprint,
        scene_glb=simulation.scene.glb(),
    )
    with run.open_writer(options.recording) as writer:
        writer.write_map(graph, known.observations)
        runner = HeadlessRunner(simulation, writer, known)
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


def _system(options: PlantVerb, predictor: Predictor, loaded: LoadedMap) -> NavigationSystem:
    """Return the map's system with the robust preset, which gives up early, and with the requested maintenance."""
    method = open_method("robust", predictor)
    short = replace(method.recovering, step_limit=options.steps, give_up_after_looks=12)
    system = recorded_system(loaded.meta.config).factory(replace(method, recovering=short))
    return system if options.maintenance is None else with_maintenance(system, options.maintenance)


def _insert_faults(
    options: PlantVerb,
    known: TopologicalMap,
    truth: GroundTruth,
) -> Iterator[Fault]:
    """Put the faults into the map; missing edges come first, so that no other fault joins the separated parts."""
    graph = known.graph
    method = known.system.method
    belief = method.believing
    near = method.building.connect_distance
    graph.apply(FramesReleased(tuple(graph.reserve), Cause.LOAD))
    plant = {
        "missing-edge": lambda: (missing_edge(graph, truth),),
        "spurious-edge": lambda: spurious_edges(graph, truth, belief, options.edges),
        "look-alike": lambda: (perceptual_alias(graph, truth, known.keyframes, known.predictor, belief, near),),
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


def _settings(options: PlantVerb, known: TopologicalMap, faults: tuple[Fault, ...]) -> dict[str, Any]:
    """Return the settings of the recording, with the faults to find in it."""
    said = [
        {"kind": fault.kind, "query": query, "start": fault.start, "goal": fault.goal, "edges": fault.edges}
        for query, fault in enumerate(faults * options.rounds)
    ]
    return {
        "verb": "plant",
        "maintenance": options.maintenance,
        "system": known.system.name,
        "seed": options.seed,
        "predictor": known.predictor_name,
        "method": asdict(known.system.method),
        "faults": said,
    }
