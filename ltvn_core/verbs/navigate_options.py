"""What `ltvn navigate` is asked and what it answers, for simulated and for other robots."""

import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from tyro.conf import Positional

from ltvn_core.errors import MapError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.option_types import AUTO, BodyOption, PredictorName
from ltvn_core.verbs.verb import Verb

if TYPE_CHECKING:
    from ltvn_core.graph.keyframes import KeyframeStore
    from ltvn_core.graph.navigation_system import NavigationSystem
    from ltvn_core.graph.topological_graph import TopologicalGraph
    from ltvn_core.recording.map_file import LoadedMap
    from ltvn_core.recording.run_description import RunDescription
    from ltvn_core.types import Predictor
    from ltvn_core.verbs.jobs.headless_runner import QueriesSummary

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


class OpenedMap(NamedTuple):
    """A saved map, and what drives by it."""

    loaded: "LoadedMap"
    predictor: "Predictor"
    predictor_name: str
    system: "NavigationSystem"
    """As it built the map, with its own maintenance."""
    keyframes: "KeyframeStore"
    """All images of the map."""


@dataclass(frozen=True, kw_only=True)
class NavigateOptions(Verb):
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
    body: BodyOption = "auto"
    robot: str | None = None
    """Drive a robot of your own, from where it stands: an installed robot's name, path/to/file.py:factory, or
    PROFILE@ADDRESS (ROS 2)."""
    stream: int | None = None
    """Port on 127.0.0.1 at which a Rerun viewer can watch while the recording is written: `ltvn view` the address."""

    def open_map(self) -> OpenedMap:
        """Open the map and say, before any drive, what it knows of the goal.

        Raises MapError, OptionError, RecordingError and WeightsError.
        """
        from ltvn_core.composition import open_method, open_predictor
        from ltvn_core.graph.keyframes import KeyframeStore
        from ltvn_core.predictors.choice import ImageSource
        from ltvn_core.recording.map_file import check_fingerprint, load_map
        from ltvn_core.systems.registry import recorded_system

        loaded = load_map(self.map)
        self._check(loaded.graph)
        meta, entry = loaded.meta, recorded_system(loaded.meta.config)
        choice = ImageSource.of(meta).choose(self.predictor)
        weights = entry.weights_for(choice.name, self.weights)
        predictor = open_predictor(choice.name, meta.scene, weights, camera=meta.camera)
        check_fingerprint(meta, predictor.fingerprint)
        system = entry.factory(open_method(self.preset, predictor))
        keyframes = KeyframeStore(predictor)
        keyframes.begin_drives(loaded.graph.drives)
        keyframes.add(list(loaded.observations.values()))
        self._tell_goal(loaded.graph, keyframes, predictor, system)
        return OpenedMap(loaded, predictor, choice.name, system, keyframes)

    def finish(
        self, opened: OpenedMap, run: "RunDescription", outcome: "QueriesSummary", wall_s: float
    ) -> NavigateSummary:
        """Save the map as driving has changed it, if asked to, and sum up."""
        graph = opened.loaded.graph
        if self.output is not None:
            images = [opened.keyframes.observation(frame) for frame in graph.frames]
            run.save_map(self.output, graph, images, origin=self.map)
        return NavigateSummary(
            recording=self.recording,
            predictor=opened.predictor_name,
            map=self.output,
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            outcome=outcome,
            wall_s=wall_s,
        )

    def _check(self, graph: "TopologicalGraph") -> None:
        """Raise MapError if the map lacks the goal and RecordingError if the output exists, before any drive."""
        from ltvn_core.atomic_files import require_new_path

        if self.goal is not None and self.goal not in graph.nodes and self.goal not in graph.reserve:
            nodes = sorted(graph.nodes)
            raise MapError(f"{self.map} has no node {self.goal}; its {len(nodes)} nodes are {nodes[0]} to {nodes[-1]}.")
        if self.output is not None:
            require_new_path(self.output)
        if len(graph.nodes) == 1:
            _LOG.warning("%s has one node, so the robot goes nowhere; build a map of a longer drive.", self.map)

    def _tell_goal(
        self, graph: "TopologicalGraph", keyframes: "KeyframeStore", predictor: "Predictor", system: "NavigationSystem"
    ) -> None:
        """Say before any drive what the map knows of the goal. Raises MapError where that is no node."""
        from ltvn_core.graph.goal_standing import goal_reports

        if self.goal is None:
            return
        (report,) = goal_reports(graph, [self.goal], keyframes, predictor, system)
        if self.goal not in graph.nodes:
            raise MapError(report.text)
        if report.text:
            _LOG.warning(report.text)

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
