"""`ltvn build`: makes a map from one recording, or from several of the same place."""

from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from ltvn_core.errors import OptionError
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.graph.connectivity import count_strongly_connected_components
from ltvn_core.graph.corrections import Correction
from ltvn_core.maps.joined_map import DriveReport
from ltvn_core.maps.map_coverage import GoalReport
from ltvn_core.maps.recorded_map import BuildOptions, build_recorded_map, save_recorded_map
from ltvn_core.sole_writer import sole_writer
from ltvn_core.verbs.build import BuildVerb
from ltvn_core.verbs.verb import Summary

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
    drives: tuple[DriveReport, ...] = ()
    """One report per drive if there are several: how it is joined to the map, and what changed since the earlier
    drives."""
    goals: tuple[GoalReport, ...] = ()
    """For each of --goals, whether the map holds it, and the most similar node if it does not."""
    corrections: tuple[Correction, ...] = ()
    """What the build corrected or added by itself, each with its own error."""
    findings: tuple[Finding, ...] = ()
    """Warnings about the drive or the map; empty if there are none."""


def build_map(options: BuildVerb) -> Summary:
    """Build and save the map; raises RecordingError, MapError and WeightsError."""
    if not options.recordings:
        raise OptionError("Name at least one recording, such as: ltvn build drive.rrd --output map.rrd")
    with sole_writer(options.output):
        return _built(options)


def _built(options: BuildVerb) -> Summary:
    wanted = BuildOptions(
        preset=options.preset,
        system=options.system,
        predictor=options.predictor,
        weights=options.weights,
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
        pieces=count_strongly_connected_components(graph),
        known_share=round(built.coverage.share, 3),
        known_by_images=round(built.coverage.by_images, 3),
        drives=built.drives,
        goals=built.goals,
        corrections=built.corrections,
        findings=built.findings,
    )
