"""`ltvn build`: makes a map from one recording, or from several of the same place."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.sole_writer import sole_writer
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.option_types import AUTO, DeviceOption, PredictorName, SystemName
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.graph.corrections import Correction
    from ltvn_core.maps.joined_map import DriveReport
    from ltvn_core.maps.map_coverage import GoalReport

_ANSWERS = ".unfinished"
"""Ending of the file beside the map that keeps the predictor's answers while the map is being built."""


@dataclass(frozen=True)
class BuildSummary(WithDoubts):
    """The size of a new map."""

    map: Path
    predictor: str
    """Name of the predictor that compared the images."""
    predictor_reason: str
    """Reason for the choice of the predictor."""
    frames: int
    """Number of images in the recording."""
    without_depth: int
    """Number of images without depth; a predictor that needs depth builds the map without them."""
    nodes: int
    edges: int
    reserve: int
    pieces: int
    """Number of pieces of the map; 1 is ideal, because then every node can be reached from every other."""
    known_share: float
    """Share of the images that are nodes of the largest piece, or are recognised as one; at other images a robot is
    lost."""
    known_by_images: float
    """The same share for the largest piece that recognised images alone hold together, without edges by odometry."""
    drives: "tuple[DriveReport, ...]" = ()
    """One report per drive if there are several: how it is joined to the map, and what changed since the earlier
    drives."""
    goals: "tuple[GoalReport, ...]" = ()
    """For each of --goals, whether the map holds it, and the most similar node if it does not."""
    corrections: "tuple[Correction, ...]" = ()
    """What the build corrected or added by itself, each with its own error."""
    findings: tuple[Finding, ...] = ()
    """Warnings about the drive or the map; empty if there are none."""


@dataclass(frozen=True, kw_only=True)
class BuildVerb(Verb):
    """Build a map from one or more recordings by Algorithm 1, or as one of the paper's rivals does."""

    recordings: Positional[tuple[Path, ...]]
    """The recordings to build from: one, or several drives of one place on other days or from other starts. Name the
    parts of one run in the order in which they were driven."""
    output: NewRecording
    """The map to write; must not exist yet."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    system: SystemName = DEFAULT_SYSTEM
    """The navigation system that builds the map and is to drive by it: ltvn is the paper's, the others are rivals."""
    predictor: PredictorName = AUTO
    """Predictor that compares images: network is the trained one, geometric needs no training and supports any camera,
    oracle is the simulator's own geometry; auto is the network for simulated images and geometric for real ones.
    """
    weights: Path | None = None
    """Weights to use instead of those that come with the system."""
    device: DeviceOption = "auto"
    goals: tuple[int, ...] = ()
    """Images, by their frame numbers, that must become nodes, because you will want to drive to them. If no other image
    recognises one, odometry joins it to the map; the command reports those that the map still does not hold."""
    seed: int = 0
    """Seed of the order in which images are sampled."""

    def run(self) -> Summary:
        """Build and save the map; raises RecordingError, MapError and WeightsError."""
        if not self.recordings:
            raise OptionError("Name at least one recording, such as: ltvn build drive.rrd --output map.rrd")
        with sole_writer(self.output):
            return _built(self)


def _built(options: BuildVerb) -> Summary:
    from tqdm import tqdm

    from ltvn_core.graph.planner import strongly_connected_components
    from ltvn_core.maps.recorded_map import BuildOptions, build_recorded_map, save_recorded_map

    wanted = BuildOptions(
        preset=options.preset,
        system=options.system,
        predictor=options.predictor,
        weights=options.weights,
        device=options.device,
        goals=options.goals,
        seed=options.seed,
    )
    answers = options.output.with_name(options.output.name + _ANSWERS)
    with tqdm(desc="build", unit="image") as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        built, choice, observations = build_recorded_map(options.recordings, wanted, show, answers=answers)
    save_recorded_map(built, options.output, wanted)
    answers.unlink(missing_ok=True)
    graph = built.graph
    assert built.coverage is not None
    return BuildSummary(
        map=options.output,
        predictor=choice.name,
        predictor_reason=choice.reason,
        frames=len(observations),
        without_depth=sum(not seen.has_depth for seen in observations),
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        reserve=len(graph.reserve),
        pieces=len(strongly_connected_components(graph)),
        known_share=round(built.coverage.share, 3),
        known_by_images=round(built.coverage.by_images, 3),
        drives=built.drives,
        goals=built.goals,
        corrections=built.corrections,
        findings=built.findings,
    )
