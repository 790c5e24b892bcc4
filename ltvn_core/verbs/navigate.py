"""`ltvn navigate`: drive by a saved map."""

import logging
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from ltvn_core.errors import MapError, OptionError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, DeviceOption, PredictorName, announce_stream
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.graph.topological_graph import TopologicalGraph
    from ltvn_core.maps.topological_map import TopologicalMap
    from ltvn_core.verbs.robot_queries import QueriesSummary

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class NavigateSummary:
    """Results of the queries."""

    recording: Path
    predictor: str
    """Predictor that compared the images."""
    map: Path | None
    """The map after all queries; None if it was not saved."""
    nodes: int
    """Number of nodes in the map at the end."""
    edges: int
    outcome: "QueriesSummary"
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class NavigateVerb(Verb):
    """Drive to one or several goals by a saved map, with the navigation system and the maintenance of the map."""

    map: Positional[Path]
    """The map to drive by; the file is never changed."""
    recording: NewRecording
    """The recording to write; it contains the map, so that it is complete on its own. Must not exist yet."""
    output: NewRecording | None = None
    """File for the map after all queries; must not exist yet."""
    goal: int | None = None
    """The node to go to, by its number; a random one if not given."""
    queries: int = 1
    """Number of random goals to drive to, one after the other."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    maintenance: MaintenanceName | None = None
    """How driving updates the map; by default as in the map's system. static: not at all; paper, robust: beliefs and
    pruning of that preset; brm: the posterior of BRM, which prunes nothing; brm-rooms: the same for connections between
    rooms; persistent: also learns when edges are open; truth: ground truth of the simulator."""
    world: str | None = None
    """Drive in a changing world: static, doors, daily, telegraph, moving, light, people, all, several of them
    (doors+moving), or a JSON file with a script. Some goals may then be impossible to reach."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    device: DeviceOption = "auto"
    seed: int = 0
    """Seed of the start, the noise and the goals."""
    body: BodyOption = "auto"
    robot: str | None = None
    """Drive your own robot, from where it stands: the name of an installed robot, path/to/file.py:factory, or
    PROFILE@ADDRESS (ROS 2)."""
    stream: int | None = None
    """Port on 127.0.0.1 for a Rerun viewer to watch the recording while it is written; open it with `ltvn view` and the
    printed address."""

    def open_map(self) -> "TopologicalMap":
        """Open the map, and report what it contains about the goal before the drive.

        Raises MapError, OptionError, RecordingError and WeightsError.
        """
        from ltvn_core.data.recording.map_file import load_map
        from ltvn_core.maps.topological_map import TopologicalMap

        loaded = load_map(self.map)
        self._check(loaded.graph)
        known = TopologicalMap.open(
            loaded, preset=self.preset, predictor=self.predictor, weights=self.weights, device=self.device
        )
        self._tell_goal(known)
        return known

    def finish(
        self, known: "TopologicalMap", run: "RunDescription", outcome: "QueriesSummary", wall_s: float
    ) -> NavigateSummary:
        """Save the map after the drive, if requested, and return the summary."""
        graph = known.graph
        if self.output is not None:
            run.save_map(self.output, graph, known.observations, origin=self.map)
        return NavigateSummary(
            recording=self.recording,
            predictor=known.predictor_name,
            map=self.output,
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            outcome=outcome,
            wall_s=wall_s,
        )

    def _check(self, graph: "TopologicalGraph") -> None:
        """Raise MapError if the map lacks the goal, before the drive."""
        if self.goal is not None and self.goal not in graph.nodes and self.goal not in graph.reserve:
            nodes = sorted(graph.nodes)
            raise MapError(f"{self.map} has no node {self.goal}; its {len(nodes)} nodes are {nodes[0]} to {nodes[-1]}.")
        if len(graph.nodes) == 1:
            _LOG.warning("%s has one node, so the robot goes nowhere; build a map of a longer drive.", self.map)

    def _tell_goal(self, known: "TopologicalMap") -> None:
        """Report before the drive what the map contains about the goal. Raises MapError if the goal is not a node."""
        if self.goal is None:
            return
        (report,) = known.goal_reports([self.goal])
        if self.goal not in known.graph.nodes:
            raise MapError(str(report.finding))
        if report.finding is not None:
            _LOG.warning(report.finding)

    def settings(self, known: "TopologicalMap") -> dict[str, Any]:
        """Return the settings of the run, for the recording."""
        from ltvn_core.predictors.request import predictor_card

        return {
            "verb": "navigate",
            "system": known.system.name,
            "maintenance": self.maintenance,
            "world": self.world,
            "predictor": known.predictor_name,
            "device": predictor_card(known.predictor).device,
            "seed": self.seed,
            "method": asdict(known.system.method),
        }

    def run(self) -> Summary:
        """Drive and maintain the map; raises MapError, OptionError, RecordingError, SceneError and WeightsError."""
        if self.queries < 1 or (self.goal is not None and self.queries > 1):
            raise OptionError(
                f"--queries must be 1 or more, and 1 where --goal names the only goal, got {self.queries}."
            )
        if self.robot is not None:
            return navigate_with(self, self.robot)
        return _drive(self)


def _drive(options: NavigateVerb) -> NavigateSummary:
    """Open all parts, run the queries, and save the map if requested."""
    import numpy as np

    from ltvn_core.cameras.rectification import rectified_camera
    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.evaluation.worlds.world_truth import true_presence, true_rooms
    from ltvn_core.robots.robot_spec import LOCOBOT
    from ltvn_core.simulation.body_selection import choose_body
    from ltvn_core.simulation.opening import open_script, open_simulation
    from ltvn_core.systems.maintenance import with_maintenance
    from ltvn_core.verbs.headless_runner import HeadlessRunner

    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    known = options.open_map()
    observation = known.keyframes.observation
    simulation = open_simulation(
        known.scene,
        seed=options.seed,
        first_step=max(known.keyframes.frames) + 1,
        start=observation(int(rng.choice(list(known.graph.nodes)))).exact_pose,  # If unknown, some free place.
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
        goals = runner.random_goals(options.queries, rng) if options.goal is None else [options.goal]
        outcome = runner.run_queries(goals, rng)
    return options.finish(known, run, outcome, time.monotonic() - started)


def navigate_with(options: NavigateVerb, name: str) -> NavigateSummary:
    """Drive a robot to goals of a map; "reached" is the robot's own belief, because the truth is unknown."""
    import numpy as np

    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.evaluation.query_run import random_goals
    from ltvn_core.systems.maintenance import with_maintenance
    from ltvn_core.verbs.robot_queries import QueriesSummary, RobotQueries, continued_robot, opened_robot

    if options.world is not None:
        raise OptionError("--world changes a simulated scene; omit it with your own robot.")
    if options.maintenance in ("truth", "brm-rooms"):
        raise OptionError(
            f"--maintenance {options.maintenance} needs the simulator; choose another one with your own robot."
        )
    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    known = options.open_map()
    if options.maintenance is not None:
        known = replace(known, system=with_maintenance(known.system, options.maintenance))
    with opened_robot(name) as own:
        robot = continued_robot(own, known)
        run = RunDescription(
            scene=known.scene,
            config={**options.settings(known), "robot": name, **own.spec.needed_space.to_config()},
            fingerprint=known.predictor.fingerprint,
            camera=robot.spec.camera,
            scene_glb=known.scene_glb,
        )
        with run.open_writer(options.recording, live_port=announce_stream(options.stream)) as writer:
            writer.write_map(known.graph, known.observations)
            driver = RobotQueries(robot, writer, known, rng)
            nodes = list(known.graph.nodes)
            goals = [options.goal] if options.goal is not None else list(random_goals(nodes, options.queries, rng))
            outcome = QueriesSummary.of([driver.drive_to(goal, query) for query, goal in enumerate(goals)])
    return options.finish(known, run, outcome, time.monotonic() - started)
