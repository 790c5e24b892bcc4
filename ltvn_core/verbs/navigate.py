"""`ltvn navigate`: drive by a saved map."""

import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from ltvn_core.errors import MapError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Verb

if TYPE_CHECKING:
    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.graph.topological_graph import TopologicalGraph
    from ltvn_core.maps.topological_map import TopologicalMap
    from ltvn_core.verbs.jobs.headless_runner import QueriesSummary


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
class NavigateOptions(Verb):
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
        known = TopologicalMap.open(loaded, preset=self.preset, predictor=self.predictor, weights=self.weights)
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
        return {
            "verb": "navigate",
            "system": known.system.name,
            "maintenance": self.maintenance,
            "world": self.world,
            "predictor": known.predictor_name,
            "seed": self.seed,
            "method": asdict(known.system.method),
        }


@dataclass(frozen=True, kw_only=True)
class NavigateVerb(NavigateOptions):
    """Drive to one or several goals by a saved map, with the navigation system and the maintenance of the map."""

    job = "ltvn_core.verbs.jobs.navigate:navigate"
