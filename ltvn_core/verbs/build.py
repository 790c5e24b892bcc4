"""`ltvn build`: a recording becomes a map, or several of one place do."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.system_option import SystemName
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.drives.joined_map import DriveReport
    from ltvn_core.graph.map_coverage import GoalReport


@dataclass(frozen=True)
class BuildSummary(WithDoubts):
    """The size of a new map."""

    map: Path
    predictor: str
    """What compared the images,"""
    predictor_reason: str
    """and why this predictor."""
    frames: int
    """Images of the recording."""
    without_depth: int
    """Images without depth among them; a predictor that needs depth builds the map without them."""
    nodes: int
    edges: int
    reserve: int
    pieces: int
    """Parts between which no path leads there and back; 1 is what one wants."""
    known_share: float
    """Share of the images that are nodes of the largest piece or recognised as one; elsewhere a robot is lost."""
    drives: "tuple[DriveReport, ...]" = ()
    """What became of each drive, where there are several: how it is joined, and what changed since those before."""
    goals: "tuple[GoalReport, ...]" = ()
    """How each of --goals stands to the map: held, unsure or not held, and which node is most like it instead."""
    findings: tuple[Finding, ...] = ()
    """What is doubtful of the drive or of the map; nothing where all is well."""


@dataclass(frozen=True, kw_only=True)
class BuildVerb(Verb):
    """Build a map from one or more recordings by Algorithm 1, or as one of the paper's rivals does."""

    recordings: Positional[tuple[Path, ...]]
    """The recording to build from; or several drives of one place, on other days, from other starts. Name the parts of
    one run in the order in which they were driven."""
    output: Path
    """The map to write; must not exist yet."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    system: SystemName = DEFAULT_SYSTEM
    """The navigation system that builds the map and is to drive by it: ltvn is the paper's, the others are rivals."""
    predictor: PredictorName = AUTO
    """What compares images: network is the trained one, geometric needs no training and takes any camera, oracle is the
    simulator's own geometry; auto is the network for simulated images and geometric for real ones."""
    weights: Path | None = None
    """Weights to use instead of those that come with the system."""
    goals: tuple[int, ...] = ()
    """Images, by their frame numbers, that must be nodes because you will want to go there; those that nothing
    recognises are tied in by odometry, and which the map does not hold all the same is said at once."""
    seed: int = 0
    """Draws the order in which images are sampled."""

    def run(self) -> Summary:
        """Build and save the map; raises RecordingError, MapError and WeightsError."""
        from tqdm import tqdm

        from ltvn_core.atomic_files import require_new_path
        from ltvn_core.graph.connectivity import count_strongly_connected_components
        from ltvn_core.recorded_map import BuildOptions, build_recorded_map, save_recorded_map

        if not self.recordings:
            raise OptionError("Name at least one recording, such as: ltvn build drive.rrd --output map.rrd")
        require_new_path(self.output)
        options = BuildOptions(
            preset=self.preset,
            system=self.system,
            predictor=self.predictor,
            weights=self.weights,
            goals=self.goals,
            seed=self.seed,
        )
        with tqdm(desc="build", unit="image") as bar:

            def show(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            built, choice, observations = build_recorded_map(self.recordings, options, show)
        save_recorded_map(built, self.output, options)
        graph = built.graph
        assert built.coverage is not None
        return BuildSummary(
            map=self.output,
            predictor=choice.name,
            predictor_reason=choice.reason,
            frames=len(observations),
            without_depth=sum(not seen.has_depth for seen in observations),
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            reserve=len(graph.reserve),
            pieces=count_strongly_connected_components(graph),
            known_share=round(built.coverage.share, 3),
            drives=built.drives,
            goals=built.goals,
            findings=built.findings,
        )
