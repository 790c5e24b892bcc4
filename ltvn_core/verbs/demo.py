"""The whole main job without a browser: collect, build, navigate with maintenance, record. Part of `ltvn demo`."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ltvn_core.errors import OptionError
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.stream_option import announce_stream
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.graph.navigation_system import NavigationSystem


@dataclass(frozen=True)
class DemoSummary:
    """What happened, in numbers."""

    recording: Path
    map: Path | None
    """The map after all queries, if it was asked for."""
    frames: int
    """Images of the mapping tour."""
    nodes: int
    """In the map at the end."""
    edges: int
    queries: int
    reached: int
    """Queries that ended within 0.72 m and 0.4 rad of the goal by the robot's own decision."""
    collisions: int
    """Touches during the queries."""
    pruned: int
    """Edges that maintenance took away."""
    added: int
    """Nodes and edges that maintenance brought in."""
    failures: dict[str, int]
    """How the other queries ended."""
    predictor: str
    preset: str
    scene: str
    seed: int
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class HeadlessDemoVerb(Verb):
    """Collect, build, navigate and record, without a browser."""

    queries: int = 20
    """How many random goals to drive to."""
    seed: int = 0
    """Draws tour, noise, map and goals."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """How often the mapping tour goes round."""
    predictor: PredictorName = AUTO
    """What compares images: the trained network, which auto takes, or another by name."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    body: BodyOption = "auto"
    recording: Path | None = None
    """The recording to write; by default runs/demo-SCENE-SEED-TIME.rrd."""
    map: Path | None = None
    """Also save the final map here."""
    stream: int | None = None
    """Port on 127.0.0.1 at which a Rerun viewer can watch while the recording is written: `ltvn view` the address."""

    story: bool = False
    """Instead of random goals: close a door on the planned way, and tell what the map learns. In the demo apartment by
    its ready-made map."""

    def run(self) -> Summary:
        """Do the job; raises OptionError, SceneError, RecordingError, MapError and WeightsError."""
        if self.queries < 0 or self.loops < 1:
            raise OptionError(
                f"--queries must be 0 or more and --loops 1 or more, got {self.queries} and {self.loops}."
            )
        if not self.story:
            return _run_headless(self)
        from ltvn_core.verbs.story_demo import StoryOptions, run_story

        return run_story(
            StoryOptions(
                scene=self.scene,
                seed=self.seed,
                loops=self.loops,
                predictor=self.predictor,
                weights=self.weights,
                preset=self.preset,
                recording=self.recording or _dated_path(f"story-{Path(self.scene).stem}-{self.seed}"),
                stream=self.stream,
                body=self.body,
                settings=self.settings,
            )
        )

    def settings(self, system: "NavigationSystem", predictor: str) -> dict[str, Any]:
        """Say how the run was made, for the recording."""
        from ltvn_core.simulation.body_selection import choose_body

        return {
            "verb": "demo",
            "system": system.name,
            "predictor": predictor,
            "seed": self.seed,
            "loops": self.loops,
            "body": choose_body(self.body),
            "method": asdict(system.method),
        }


def _dated_path(name: str) -> Path:
    return Path("runs") / time.strftime(f"{name}-%Y%m%d-%H%M%S.rrd")


def _run_headless(options: HeadlessDemoVerb) -> DemoSummary:
    import numpy as np

    from ltvn_core.atomic_files import require_new_path
    from ltvn_core.predictors.choice import ImageSource
    from ltvn_core.predictors.opening import open_method, open_predictor, simulated_robot
    from ltvn_core.recording.run_description import RunDescription
    from ltvn_core.robots.robot_spec import LOCOBOT
    from ltvn_core.simulation.opening import open_simulation
    from ltvn_core.systems.registry import DEFAULT_SYSTEM, open_system
    from ltvn_core.topological_map import TopologicalMap
    from ltvn_core.verbs.headless_runner import HeadlessRunner

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
        config=options.settings(system, choice.name),
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
        **asdict(outcome),
        predictor=choice.name,
        preset=options.preset,
        scene=simulation.scene.name,
        seed=options.seed,
        wall_s=time.monotonic() - started,
    )
