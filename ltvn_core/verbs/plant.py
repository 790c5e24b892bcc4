"""`ltvn plant`: faults in a good map, and queries that meet them, for practice with the debugger and for its tests."""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro
from tyro.conf import Positional

from ltvn_core.errors import MapError, OptionError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.fault_injection import Fault
    from ltvn_core.evaluation.ground_truth import GroundTruth
    from ltvn_core.graph.navigation_system import NavigationSystem
    from ltvn_core.graph.topological_graph import TopologicalGraph
    from ltvn_core.recording.map_file import LoadedMap
    from ltvn_core.topological_map import TopologicalMap
    from ltvn_core.types import Predictor
    from ltvn_core.verbs.headless_runner import QueriesSummary

FaultName = Literal["spurious-edge", "look-alike", "missing-edge"]


@dataclass(frozen=True)
class PlantSummary:
    """What was planted, and what became of the queries that met it."""

    recording: Path
    faults: "tuple[Fault, ...]"
    """One for each query of a round."""
    nodes: int
    edges: int
    outcome: "QueriesSummary"
    pruned_spurious: int
    """How many of the edges that were pruned are spurious by the truth."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class PlantVerb(Verb):
    """Plant faults in a simulated map and record a query that meets each: something to find for a debugger.

    The map's reserve is left out, so that the map cannot be mended with it.
    """

    map: Positional[Path]
    """A map of a simulated scene; it is read, never changed."""
    recording: Path
    """The recording to write; it begins with the faulty map. Must not exist yet."""
    fault: tyro.conf.UseAppendAction[tuple[FaultName, ...]] = ()
    """What to plant; may be given several times. There is a query for each in the same order, so what is given twice is
    met twice. If not given, all three are planted and the first is met twice."""
    edges: int = 1
    """So many different spurious edges where they are planted, each with queries of its own."""
    rounds: int = 1
    """All queries are driven so often."""
    maintenance: MaintenanceName | None = None
    """What driving teaches the map; by default what the system of the map does."""
    steps: int = 80
    """Control steps of 0.1 s that end a query."""
    predictor: PredictorName = AUTO
    """What compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    seed: int = 0
    """Draws the noise."""
    body: BodyOption = "auto"

    @property
    def kinds(self) -> tuple[FaultName, ...]:
        """What the queries meet, one after the other."""
        return self.fault or ("spurious-edge", "spurious-edge", "look-alike", "missing-edge")

    def run(self) -> Summary:
        """Plant, drive and record; raises OptionError, MapError, RecordingError, SceneError and WeightsError."""
        if self.steps < 1:
            raise OptionError(f"--steps must be 1 or more, got {self.steps}.")
        if self.edges < 1 or self.rounds < 1:
            raise OptionError(f"--edges and --rounds must be 1 or more, got {self.edges} and {self.rounds}.")
        return _drive(self)


def _drive(options: PlantVerb) -> PlantSummary:
    import numpy as np

    from ltvn_core.evaluation.ground_truth import GroundTruth
    from ltvn_core.recording.map_file import load_map
    from ltvn_core.recording.run_description import RunDescription
    from ltvn_core.simulation.body_selection import choose_body
    from ltvn_core.simulation.opening import open_simulation
    from ltvn_core.simulation.scene_registry import load_scene
    from ltvn_core.topological_map import TopologicalMap
    from ltvn_core.verbs.headless_runner import HeadlessRunner

    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    loaded = load_map(options.map)
    graph = loaded.graph
    if len(graph.nodes) < 2:
        raise MapError(f"{options.map} has one node; faults lie between nodes, so choose a larger map.")
    opened = TopologicalMap.open(loaded, predictor=options.predictor, weights=options.weights, with_reserve=False)
    known = replace(opened, system=_system(options, opened.predictor, loaded))
    truth = GroundTruth(load_scene(known.scene).clearance, lambda node: loaded.observations[node])
    faults = tuple(_insert_faults(options, known, truth))
    spurious = truth.spurious(graph)
    start, first_step = loaded.observations[faults[0].start].exact_pose, max(loaded.observations) + 1
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


def _system(options: PlantVerb, predictor: "Predictor", loaded: "LoadedMap") -> "NavigationSystem":
    """Return the map's system with the robust preset, which gives up early, and the maintenance that is asked for."""
    from ltvn_core.predictors.opening import open_method
    from ltvn_core.systems.maintenance import with_maintenance
    from ltvn_core.systems.registry import recorded_system

    method = open_method("robust", predictor)
    short = replace(method.recovering, step_limit=options.steps, give_up_after_looks=12)
    system = recorded_system(loaded.meta.config).factory(replace(method, recovering=short))
    return system if options.maintenance is None else with_maintenance(system, options.maintenance)


def _insert_faults(
    options: PlantVerb,
    known: "TopologicalMap",
    truth: "GroundTruth",
) -> "Iterator[Fault]":
    """Put the faults into the map; cut first, so that no other fault joins what is cut."""
    from ltvn_core.evaluation.fault_injection import missing_edge, perceptual_alias, spurious_edges
    from ltvn_core.graph.deltas import Cause, FramesReleased

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


def _apply_fault(graph: "TopologicalGraph", fault: "Fault") -> None:
    for delta in fault.deltas:
        graph.apply(delta)


def _settings(options: PlantVerb, known: "TopologicalMap", faults: "tuple[Fault, ...]") -> dict[str, Any]:
    """Say how the recording was made, and what is to be found in it."""
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
