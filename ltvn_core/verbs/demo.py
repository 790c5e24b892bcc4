"""The complete workflow without a browser: collect, build, navigate with maintenance, record. Part of `ltvn demo`.

With `--story` a door closes on the planned path, and the map learns.
"""

import logging
import time
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ltvn_core.errors import OptionError
from ltvn_core.systems.registry import DEFAULT_SYSTEM, open_system
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName, announce_stream
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import FLAT, Summary, Verb

if TYPE_CHECKING:
    import numpy as np

    from ltvn_core.data.recording.map_file import LoadedMap
    from ltvn_core.evaluation.door_story.story import DoorStory
    from ltvn_core.graph.navigation_system import NavigationSystem
    from ltvn_core.navigation.events import Event
    from ltvn_core.simulation.opening import Simulation
    from ltvn_core.types import Predictor
    from ltvn_core.verbs.headless_runner import HeadlessRunner
    from ltvn_core.verbs.robot_queries import QueriesSummary

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class DemoSummary:
    """Results of the demo."""

    outcome: "QueriesSummary" = field(metadata=FLAT)
    recording: Path
    map: Path | None
    """The map after all queries; None if it was not saved."""
    frames: int
    """Number of images of the mapping tour."""
    nodes: int
    """Number of nodes in the map at the end."""
    edges: int
    predictor: str
    preset: str
    scene: str
    seed: int
    wall_s: float


@dataclass(frozen=True)
class StorySummary:
    """Changes of the map when a door closed and opened again."""

    absent: int
    """Number of edges that were seen blocked."""
    rerouted: bool
    """Whether a plan turned away from the closed door."""
    added: int
    """Number of nodes and edges that were added while driving."""
    returned: int
    """Number of edges that were seen blocked, and open again later."""
    pruned: int
    """Number of edges that failed too often and were removed."""
    captions: list[str]
    """The story in words."""
    recording: Path
    scene: str
    predictor: str
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class HeadlessDemoVerb(Verb):
    """Collect, build, navigate and record, without a browser."""

    queries: int = 20
    """Number of random goals to drive to."""
    seed: int = 0
    """Seed of tour, noise, map and goals."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """Number of rounds of the mapping drive."""
    predictor: PredictorName = AUTO
    """Predictor that compares images: the trained network, which auto uses, or another by name."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    body: BodyOption = "auto"
    recording: NewRecording | None = None
    """The recording to write; by default runs/demo-SCENE-SEED-TIME.rrd."""
    map: NewRecording | None = None
    """Also save the final map here."""
    stream: int | None = None
    """Port on 127.0.0.1 for a Rerun viewer to watch the recording while it is written; open it with `ltvn view` and the
    printed address."""

    story: bool = False
    """Instead of driving to random goals, close a door on the planned path and show what the map learns. It plays in
    the shipped map of the demo apartment."""

    def run(self) -> Summary:
        """Run the demo; raises OptionError, SceneError, RecordingError, MapError and WeightsError."""
        if self.queries < 0 or self.loops < 1:
            raise OptionError(
                f"--queries must be 0 or more and --loops 1 or more, got {self.queries} and {self.loops}."
            )
        return _run_story(self) if self.story else _run_headless(self)


def _settings(options: HeadlessDemoVerb, system: "NavigationSystem", predictor: str) -> dict[str, Any]:
    """Return the settings of the run, for the recording."""
    from ltvn_core.simulation.body_selection import choose_body

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
    import numpy as np

    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.maps.topological_map import TopologicalMap
    from ltvn_core.predictors.choice import ImageSource
    from ltvn_core.predictors.opening import open_method, open_predictor, simulated_robot
    from ltvn_core.robots.robot_spec import LOCOBOT
    from ltvn_core.simulation.opening import open_simulation
    from ltvn_core.verbs.headless_runner import HeadlessRunner

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
        outcome=outcome,
        predictor=choice.name,
        preset=options.preset,
        scene=simulation.scene.name,
        seed=options.seed,
        wall_s=time.monotonic() - started,
    )


def _run_story(options: HeadlessDemoVerb) -> StorySummary:
    """Play the story in the shipped map and record it. Raises OptionError if another map or network is asked for."""
    import numpy as np

    from ltvn_core.data.recording.demo_files import DEMO_MAP, demo_file
    from ltvn_core.data.recording.map_file import load_map
    from ltvn_core.evaluation.door_story.story_map import NO_STORY, SCENE
    from ltvn_core.predictors.choice import ImageSource
    from ltvn_core.predictors.opening import open_predictor, simulated_robot
    from ltvn_core.robots.robot_spec import LOCOBOT
    from ltvn_core.simulation.opening import open_simulation

    started = time.monotonic()
    rng = np.random.default_rng(options.seed)
    choice = ImageSource(camera=LOCOBOT.camera).choose(options.predictor)
    spec = simulated_robot(choice.name)
    predictor = open_predictor(choice.name, options.scene, options.weights, camera=spec.camera)
    place = demo_file(DEMO_MAP) if options.scene == SCENE else None
    known = None if place is None else load_map(place)
    if known is None or known.meta.fingerprint != predictor.fingerprint:
        raise OptionError(f"{NO_STORY} --headless --story, without another --scene, --predictor or --weights.")
    simulation = open_simulation(
        options.scene,
        seed=options.seed,
        spec=spec,
        first_step=max(known.observations) + 1,
        start=known.observations[int(rng.choice(list(known.graph.nodes)))].exact_pose,
        body=options.body,
    )
    recording = options.recording or _dated_path(f"story-{Path(options.scene).stem}-{options.seed}")
    story = _play_recorded(replace(options, predictor=choice.name), recording, simulation, predictor, known, rng)
    return StorySummary(
        absent=len(story.facts.absent),
        rerouted=story.facts.rerouted,
        added=story.facts.nodes_added + story.facts.edges_added,
        returned=len(story.facts.returned),
        pruned=len(story.facts.pruned),
        captions=list(story.captions),
        recording=recording,
        scene=simulation.scene.name,
        predictor=choice.name,
        wall_s=time.monotonic() - started,
    )


def _play_recorded(
    options: HeadlessDemoVerb,
    recording: Path,
    simulation: "Simulation",
    predictor: "Predictor",
    known: "LoadedMap",
    rng: "np.random.Generator",
) -> "DoorStory":
    """Play the story in the shipped map."""
    from ltvn_core.data.recording.recorded_run import RunDescription
    from ltvn_core.evaluation.door_story.story import STORY_MAINTENANCE, DoorStory
    from ltvn_core.evaluation.door_story.story_map import StoryMap
    from ltvn_core.maps.topological_map import TopologicalMap
    from ltvn_core.predictors.opening import open_method
    from ltvn_core.simulation.scene import door_names
    from ltvn_core.systems.maintenance import with_maintenance
    from ltvn_core.verbs.headless_runner import HeadlessRunner

    system = with_maintenance(open_system(DEFAULT_SYSTEM, open_method(options.preset, predictor)), STORY_MAINTENANCE)
    run = RunDescription(
        scene=simulation.scene.address,
        config=_settings(options, system, options.predictor) | {"maintenance": STORY_MAINTENANCE},
        fingerprint=predictor.fingerprint,
        camera=simulation.robot.spec.camera,
        scene_glb=simulation.scene.glb(),
    )
    begun = TopologicalMap.take(known, predictor, system)
    with run.open_writer(recording, live_port=announce_stream(options.stream)) as writer:
        writer.write_map(begun.graph, begun.observations)
        runner = HeadlessRunner(simulation, writer, begun)
        story_map = StoryMap(begun.graph, system, runner.world, begun.keyframes.observation)
        story = DoorStory(story_map, door_names(simulation.scene), lambda: runner.robot.state().stamp)
        play_story(story, runner, rng)
    return story


def play_story(story: "DoorStory", runner: "HeadlessRunner", rng: "np.random.Generator") -> None:
    """Play a story to its end, and store its captions."""
    from ltvn_core.evaluation.door_story.story import Carry, Change, Edit, GoTo, Lead, Wait
    from ltvn_core.evaluation.query_run import run_query
    from ltvn_core.navigation.events import GraphChanged, Note

    navigator = runner.navigator(rng)
    told = 0
    queries = 0

    def take(event: "Event | None" = None) -> None:
        nonlocal told
        if event is not None:
            story.take(event)
        for text in story.captions[told:]:
            _LOG.info(text)
            runner.record(Note(text))
        told = len(story.captions)

    def consume(event: "Event") -> None:
        runner.record(event)
        take(event)

    def advance() -> None:
        while isinstance(step := story.next_step(is_idle=False), Wait):
            take()
            runner.robot.stop()
            runner.advance()
        take()
        if isinstance(step, Change):
            runner.world.apply(step.change)
        runner.advance()

    while (step := story.next_step(is_idle=True)) is not None:
        take()
        match step:
            case Wait():
                runner.advance()
            case Change(change):
                runner.world.apply(change)
            case Edit(delta):
                runner.map.graph.apply(delta)
                consume(GraphChanged(delta))
            case Carry(pose):
                runner.robot.teleport(pose)
            case Lead(path):
                runner.lead(path, take)
            case GoTo(goal):
                verdict = partial(runner.verdict, queries, goal)
                run_query(navigator, goal, queries, advance=advance, verdict=verdict, consume=consume)
                queries += 1
    take()
    for delta in story.leftovers():
        runner.map.graph.apply(delta)
        runner.record(GraphChanged(delta))
