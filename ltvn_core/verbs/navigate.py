"""`ltvn navigate | lifelong`: drive by a saved map."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from ltvn_core.errors import MapError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from collections.abc import Callable

    from ltvn_core.verbs.headless import Tally, Workbench


@dataclass(frozen=True)
class Navigated:
    """What the queries came to."""

    recording: Path
    map: Path | None
    nodes: int
    edges: int
    queries: int
    reached: int
    """Queries that ended within 0.72 m and 0.4 rad of the goal by the robot's own decision."""
    collisions: int
    pruned: int
    added: int
    failures: dict[str, int]
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class _ByMap(Verb):
    """Options shared by the verbs that drive by a saved map."""

    map: Positional[Path]
    """The map to drive by; it is read, never changed."""
    recording: Path
    """The recording to write; it begins with the map, so it stands alone. Must not exist yet."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    predictor: Literal["network", "oracle"] = "network"
    """What compares images; must be the one that built the map."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    seed: int = 0
    """Draws the start, the noise and the goals."""

    def settings(self) -> dict[str, Any]:
        """Say how the run was made, for the recording."""
        from ltvn_core.config import preset

        return {"verb": type(self).__name__.lower(), "seed": self.seed, "method": asdict(preset(self.preset))}


@dataclass(frozen=True, kw_only=True)
class Navigate(_ByMap):
    """Drive to one goal by a saved map."""

    goal: int | None = None
    """The node to go to, by its number; a random one if not given."""

    def run(self) -> Summary:
        """Drive there; raises MapError, RecordingError, SceneError and WeightsError."""

        def drive(bench: "Workbench", tally: "Tally") -> int:
            import numpy as np

            rng = np.random.default_rng(self.seed)
            goal = bench.random_goal(rng) if self.goal is None else self.goal
            if goal not in bench.graph.nodes:
                raise MapError(f"{self.map}: there is no node {goal}; see `ltvn info`, or leave --goal out.")
            bench.run_query(bench.navigator(rng), goal, 0, tally)
            return 1

        return _drive(self, drive, output=None)


@dataclass(frozen=True, kw_only=True)
class Lifelong(_ByMap):
    """Drive to many random goals by a saved map, which learns from every drive."""

    queries: int = 100
    """How many random goals to drive to."""
    output: Path
    """The map after all queries; must not exist yet."""

    def run(self) -> Summary:
        """Drive and learn; raises MapError, RecordingError, SceneError and WeightsError."""

        def drive(bench: "Workbench", tally: "Tally") -> int:
            import numpy as np

            bench.run_queries(self.queries, np.random.default_rng(self.seed), tally)
            return self.queries

        return _drive(self, drive, output=self.output)


def _drive(options: _ByMap, drive: "Callable[[Workbench, Tally], int]", output: Path | None) -> Navigated:
    """Open everything, let `drive` run its queries, save the map if asked to."""
    import numpy as np

    from ltvn_core.composition import open_predictor, open_simulation
    from ltvn_core.config import preset
    from ltvn_core.graph.views import Views
    from ltvn_core.recording.maps import check_fingerprint, load_map, save_map
    from ltvn_core.recording.writer import RecordingWriter
    from ltvn_core.verbs.headless import Tally, Workbench

    started = time.monotonic()
    loaded = load_map(options.map)
    scene = loaded.meta.scene
    predictor = open_predictor(options.predictor, scene, options.weights)
    check_fingerprint(loaded.meta, predictor.fingerprint)
    start = np.random.default_rng(options.seed).choice(list(loaded.graph.nodes))
    simulation = open_simulation(
        scene,
        seed=options.seed,
        first_step=max(loaded.observations) + 1,
        start=loaded.observations[int(start)].exact_pose,
    )
    views = Views(predictor)
    views.add(list(loaded.observations.values()))
    about = {"scene": scene, "config": options.settings(), "fingerprint": predictor.fingerprint}
    with RecordingWriter(options.recording, **about) as writer:
        writer.map(loaded.graph, loaded.observations.values())
        bench = Workbench(simulation, writer, views, predictor, preset(options.preset), loaded.graph)
        tally = Tally()
        queries = drive(bench, tally)
    if output is not None:
        save_map(output, bench.graph, bench.kept(), **about)
    return Navigated(
        recording=options.recording,
        map=output,
        nodes=len(bench.graph.nodes),
        edges=len(bench.graph.edges),
        queries=queries,
        **tally.summary(),
        wall_s=time.monotonic() - started,
    )
