"""`ltvn navigate`: drive by a saved map."""

import logging
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from ltvn_core.errors import MapError, OptionError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.stream_option import announce_stream
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from ltvn_core.graph.navigation_system import NavigationSystem
    from ltvn_core.graph.topological_graph import TopologicalGraph
    from ltvn_core.recording.map_file import LoadedMap
    from ltvn_core.types import NodeId, Pose
    from ltvn_core.verbs.headless_runner import HeadlessRunner, QueriesSummary


_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class NavigateSummary:
    """What the queries came to."""

    recording: Path
    predictor: str
    """What compared the images."""
    map: Path | None
    """The map after all queries, if it was asked for."""
    nodes: int
    """In the map at the end."""
    edges: int
    outcome: "QueriesSummary"
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class NavigateVerb(Verb):
    """Drive to one goal or to several by a saved map, with the navigation system that built it and as it maintains."""

    map: Positional[Path]
    """The map to drive by; it is read, never changed."""
    recording: Path
    """The recording to write; it begins with the map, so it stands alone. Must not exist yet."""
    output: Path | None = None
    """The map after all queries, with what it learned; must not exist yet."""
    goal: int | None = None
    """The node to go to, by its number; a random one if not given."""
    queries: int = 1
    """How many random goals to drive to, one after the other."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    maintenance: MaintenanceName | None = None
    """What driving teaches the map; by default what its system does. static: nothing; paper, robust: beliefs and
    pruning as in that preset; brm: BRM's posterior, which prunes nothing; brm-rooms: the same of ways between rooms;
    persistent, forgetting, fremen: also what is open at which time; truth: what the simulator knows."""
    world: str | None = None
    """Drive in a world that changes: static, doors, daily, telegraph, moving, light, people, all, several of them
    (doors+moving), or a JSON file with a script. A goal may be out of reach then."""
    predictor: PredictorName = AUTO
    """What compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    seed: int = 0
    """Draws the start, the noise and the goals."""
    stream: int | None = None
    """Port on 127.0.0.1 at which a Rerun viewer can watch while the recording is written: `ltvn view` the address."""

    def run(self) -> Summary:
        """Drive and learn; raises MapError, OptionError, RecordingError, SceneError and WeightsError."""
        if self.queries < 1 or (self.goal is not None and self.queries > 1):
            raise OptionError(
                f"--queries must be 1 or more, and 1 where --goal names the only goal, got {self.queries}."
            )
        return _drive(self)

    def check(self, graph: "TopologicalGraph") -> None:
        """Raise MapError if the map lacks the goal and RecordingError if the output exists, before any drive."""
        from ltvn_core.atomic_files import require_new_path

        if self.goal is not None and self.goal not in graph.nodes:
            nodes = sorted(graph.nodes)
            raise MapError(f"{self.map} has no node {self.goal}; its {len(nodes)} nodes are {nodes[0]} to {nodes[-1]}.")
        if self.output is not None:
            require_new_path(self.output)
        if len(graph.nodes) == 1:
            _LOG.warning("%s has one node, so the robot goes nowhere; build a map of a longer drive.", self.map)

    def goals(self, runner: "HeadlessRunner", rng: "np.random.Generator") -> "Sequence[NodeId]":
        """Go to the one goal, or to random nodes."""
        return runner.random_goals(self.queries, rng) if self.goal is None else [self.goal]

    def settings(self, system: "NavigationSystem", predictor: str) -> dict[str, Any]:
        """Say how the run was made, for the recording."""
        return {
            "verb": "navigate",
            "system": system.name,
            "maintenance": self.maintenance,
            "world": self.world,
            "predictor": predictor,
            "seed": self.seed,
            "method": asdict(system.method),
        }


def _drive(options: NavigateVerb) -> NavigateSummary:
    """Open everything, run the queries, save the map if asked to."""
    import numpy as np

    from ltvn_core.cameras.rectification import rectified_camera
    from ltvn_core.composition import open_method, open_predictor, open_script, open_simulation
    from ltvn_core.evaluation.open_edges import true_presence
    from ltvn_core.evaluation.true_rooms import true_rooms
    from ltvn_core.graph.keyframes import KeyframeStore
    from ltvn_core.predictors.choice import ImageSource
    from ltvn_core.recording.map_file import check_fingerprint, load_map
    from ltvn_core.recording.run_description import RunDescription
    from ltvn_core.robots.robot_spec import LOCOBOT
    from ltvn_core.systems.maintenance import with_maintenance
    from ltvn_core.systems.registry import recorded_system
    from ltvn_core.verbs.headless_runner import HeadlessRunner

    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    loaded = load_map(options.map)
    options.check(loaded.graph)
    meta = loaded.meta
    entry = recorded_system(meta.config)
    choice = ImageSource.of(meta).choose(options.predictor)
    weights = entry.weights_for(choice.name, options.weights)
    predictor = open_predictor(choice.name, meta.scene, weights, camera=meta.camera)
    check_fingerprint(meta, predictor.fingerprint)
    system = entry.factory(open_method(options.preset, predictor))
    simulation = open_simulation(
        meta.scene,
        seed=options.seed,
        first_step=max(loaded.observations) + 1,
        start=_start(loaded, rng),
        spec=replace(LOCOBOT, camera=rectified_camera(LOCOBOT.camera, predictor.camera)),
        script=None if options.world is None else open_script(options.world, meta.scene, seed=options.seed),
    )
    keyframes = KeyframeStore(predictor)
    keyframes.begin_drives(loaded.graph.drives)
    keyframes.add(list(loaded.observations.values()))
    if options.maintenance is not None:
        truth = true_presence(simulation.world, keyframes.observation)
        room_of = true_rooms(simulation.scene, keyframes.observation)
        system = with_maintenance(system, options.maintenance, truth=truth, room_of=room_of)
    run = RunDescription(
        scene=meta.scene,
        config=options.settings(system, choice.name),
        fingerprint=predictor.fingerprint,
        camera=simulation.robot.spec.camera,
    )
    with run.open_writer(options.recording, live_port=announce_stream(options.stream)) as writer:
        writer.write_map(loaded.graph, loaded.observations.values())
        runner = HeadlessRunner(simulation, writer, keyframes, predictor, system, loaded.graph)
        outcome = runner.run_queries(options.goals(runner, rng), rng)
    if options.output is not None:
        run.save_map(options.output, runner.graph, runner.map_observations(), origin=options.map)
    return NavigateSummary(
        recording=options.recording,
        predictor=choice.name,
        map=options.output,
        nodes=len(runner.graph.nodes),
        edges=len(runner.graph.edges),
        outcome=outcome,
        wall_s=time.monotonic() - started,
    )


def _start(loaded: "LoadedMap", rng: "np.random.Generator") -> "Pose | None":
    """Return where a random node's image was taken; None, a free place, if nobody knows."""
    return loaded.observations[int(rng.choice(list(loaded.graph.nodes)))].exact_pose
