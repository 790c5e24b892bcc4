"""What is doubtful of a map as a whole, in words. Decides nothing: such a map is kept and can be driven by."""

from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.map_coverage import MapCoverage
from ltvn_core.graph.topological_graph import TopologicalGraph

MANY_NODES = 6
SMALL_PIECE = 0.5
"""A map of so many nodes is in pieces when the largest piece has a smaller share of them."""
MANY_IMAGES = 20
"""From so many images on a map of one node is doubtful; a drive of two metres has as many."""
LITTLE_KNOWN = 0.8
"""A map that knows a smaller share of its own drive leaves the robot lost on the rest."""


def map_doubts(graph: TopologicalGraph, images: int, coverage: MapCoverage | None = None) -> tuple[str, ...]:
    """Return what is doubtful of a map that was built from so many images; nothing for a map that is in order.

    Without its `coverage` nobody asks how much of the drive the map knows.
    """
    if images < MANY_IMAGES:
        return ()
    if len(graph.nodes) == 1:
        return (
            f"The map has one node, as if all {images} images showed one place, and nobody can navigate by it. Does "
            "the camera work, and is it the one that the weights were trained for?",
        )
    if len(graph.nodes) > 1 and not graph.edges:
        return (
            f"None of the {len(graph.nodes)} nodes is joined to another, and nobody can navigate by this map. Are the "
            "images far apart, or the weights trained for another camera?",
        )
    if len(graph.nodes) >= MANY_NODES:
        pieces = strongly_connected_components(graph)
        if len(pieces[0]) < SMALL_PIECE * len(graph.nodes):
            return (
                f"The map falls into {len(pieces)} pieces, the largest with {len(pieces[0])} of {len(graph.nodes)} "
                "nodes, and between them nobody can navigate. Drive the ways between them too, slowly and both ways "
                "round.",
            )
    if coverage is not None and coverage.gap is not None and coverage.share < LITTLE_KNOWN:
        return (
            f"The map knows {coverage.share:.0%} of its own drive: the other images are neither nodes of its largest "
            f"piece nor recognised as one, so there the robot will be lost. The longest such part is from "
            f"{coverage.gap.begin_s:.1f} s to {coverage.gap.end_s:.1f} s of {coverage.gap.drive or 'the drive'}; "
            "drive it again, slowly.",
        )
    return ()
