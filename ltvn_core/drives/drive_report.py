"""What became of each of several drives in their map, for a person and for a program. Owns the words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ltvn_core.drives.drive_contradictions import DriveComparison
from ltvn_core.drives.joined_drives import JoinedDrive
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_FEW = 0.1
"""Where less of a drive than this is recognised, the map hangs together by little."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveReport:
    """One drive in the map."""

    name: str
    first: int
    """Its first image, as it is numbered in the map,"""
    added_steps: int
    """and so much more than in its recording."""
    nodes: int
    joined_by: int
    """Edges between its nodes and those of the drives before; 0 for the first."""
    joined_by_odometry: int
    """Those among them that odometry alone speaks for."""
    continues: str
    """Name of the drive before it in whose odometry it goes on; empty where its odometry begins anew."""
    recognised: float | None
    """Share of its images whose place the drives before had seen; None for the first."""
    blocked: tuple[EdgeKey, ...]
    """Edges of the drives before that it saw blocked,"""
    returned: tuple[EdgeKey, ...]
    """and those that were seen blocked before and that it found open."""

    @property
    def is_piece_of_its_own(self) -> bool:
        """No image of it was recognised in the drives before, so nothing joins it to them."""
        return self.recognised is not None and not self.joined_by and not self.recognised

    def __str__(self) -> str:
        if self.recognised is None:
            return f"{self.name}: {self.nodes} nodes"
        joined = f"{self.recognised:.0%} recognised, joined by {self.joined_by} edges"
        seen = f"{len(self.blocked)} edges seen blocked, {len(self.returned)} open again"
        return f"{self.name}: {self.nodes} new nodes, images from {self.first} on, {joined}; {seen}{self._continued}"

    @property
    def _continued(self) -> str:
        if not self.continues:
            return ""
        by_images = self.joined_by - self.joined_by_odometry
        by = [name for name, count in (("images", by_images), ("odometry", self.joined_by_odometry)) if count]
        joined = f"joined by {' and '.join(by)}" if by else "no edge joins them"
        return f"; {self.name} continues {self.continues}: {joined}"


def report_drive(graph: TopologicalGraph, drive: JoinedDrive, comparison: DriveComparison | None) -> DriveReport:
    """Return what became of a drive; `comparison` with those before is None for the first. Linear in the map."""
    crossing = [
        edge
        for key, edge in graph.edges.items()
        if drive.holds(key[0]) != drive.holds(key[1]) and max(key) <= drive.last
    ]
    observed = () if comparison is None else comparison.observed
    return DriveReport(
        name=drive.name,
        first=drive.first,
        added_steps=drive.added_steps,
        nodes=sum(drive.holds(node) for node in graph.nodes),
        joined_by=len(crossing),
        joined_by_odometry=sum(edge.by_odometry for edge in crossing),
        continues=drive.continues,
        recognised=None if comparison is None else round(comparison.share, 3),
        blocked=tuple((each.source, each.target) for each in observed if not each.present),
        returned=tuple((each.source, each.target) for each in observed if each.present),
    )


def drive_doubts(reports: Sequence[DriveReport]) -> Iterator[str]:
    """Yield what a person must know of drives that hardly meet, with what to do."""
    for report in reports[1:]:
        if report.is_piece_of_its_own:
            yield (
                f"No image of {report.name} was recognised in the drives before it: its {report.nodes} nodes are a "
                "piece of their own, and no way leads there. Drive through a place that both show, looking the same "
                "way, or try another --predictor."
            )
        elif not report.joined_by and report.nodes:
            yield (
                f"No edge joins {report.name} to the drives before it, though {report.recognised:.0%} of its images "
                "look like places there. Drive more slowly where both were, or try another --predictor."
            )
        elif report.recognised is not None and report.recognised < _FEW and not report.continues:
            yield f"Only {report.recognised:.0%} of {report.name} was recognised in the drives before it."
