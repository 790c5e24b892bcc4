"""`ltvn build`: a recording becomes a map, or several of one place do."""

from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from ltvn_core.atomic_files import require_new_path
from ltvn_core.errors import OptionError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.graph.connectivity import count_strongly_connected_components
from ltvn_core.graph.map_coverage import GoalReport
from ltvn_core.maps.joined_map import DriveReport
from ltvn_core.maps.recorded_map import BuildOptions, build_recorded_map, save_recorded_map
from ltvn_core.verbs.build import BuildVerb
from ltvn_core.verbs.verb import Summary


@dataclass(frozen=True)
class BuildSummary(WithDoubts):
    """The size of a new map."""

    map: Path
    predictor: str
    """Name of the predictor that compared the images."""
    predictor_reason: str
    """Reason for the choice of the predictor."""
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
    drives: tuple[DriveReport, ...] = ()
    """Report on each of several drives: how it is joined, and what changed since the drives before it."""
    goals: tuple[GoalReport, ...] = ()
    """How each of --goals stands to the map: held, unsure or not held, and which node is most like it instead."""
    findings: tuple[Finding, ...] = ()
    """Doubts about the drive or the map; empty if there are none."""


def build_map(options: BuildVerb) -> Summary:
    """Build and save the map; raises RecordingError, MapError and WeightsError."""
    if not options.recordings:
        raise OptionError("Name at least one recording, such as: ltvn build drive.rrd --output map.rrd")
    require_new_path(options.output)
    wanted = BuildOptions(
        preset=options.preset,
        system=options.system,
        predictor=options.predictor,
        weights=options.weights,
        goals=options.goals,
        seed=options.seed,
    )
    with tqdm(desc="build", unit="image") as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        built, choice, observations = build_recorded_map(options.recordings, wanted, show)
    save_recorded_map(built, options.output, wanted)
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
        pieces=count_strongly_connected_components(graph),
        known_share=round(built.coverage.share, 3),
        drives=built.drives,
        goals=built.goals,
        findings=built.findings,
    )
