"""What is doubtful of a map as a whole, in words. Decides nothing: such a map is kept and can be driven by."""

from collections.abc import Iterator

from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.map_coverage import MapCoverage
from ltvn_core.graph.topological_graph import TopologicalGraph

MANY_NODES = 6
SMALL_PIECE = 0.5
"""A map of so many nodes is in pieces when the largest piece has a smaller share of them."""
MANY_IMAGES = 20
"""A drive of two metres has so many images; a shorter one may show one place indeed."""
LITTLE_KNOWN = 0.8
"""A map that knows a smaller share of its own drive leaves the robot lost on the rest."""


def map_doubts(graph: TopologicalGraph, images: int, coverage: MapCoverage) -> tuple[str, ...]:
    """Return what is doubtful of a map; nothing for a map that is in order, or of less than two images.

    Args:
        graph: The map.
        images: Number of images that it was built from.
        coverage: How much of them it knows.
    """
    if images < 2:
        return ()
    return (*_joint_doubts(graph, images, coverage), *_coverage_doubts(coverage))


def _joint_doubts(graph: TopologicalGraph, images: int, coverage: MapCoverage) -> Iterator[str]:
    """Yield what is doubtful of nodes and edges alone."""
    if len(graph.nodes) == 1:
        yield _one_node(images, coverage)
    elif len(graph.nodes) > 1 and not graph.edges:
        yield (
            f"None of the {len(graph.nodes)} nodes is joined to another, and nobody can navigate by this map. Are the "
            "images far apart, or the weights trained for another camera?"
        )
    elif len(graph.nodes) >= MANY_NODES:
        pieces = strongly_connected_components(graph)
        if len(pieces[0]) < SMALL_PIECE * len(graph.nodes):
            yield (
                f"The map falls into {len(pieces)} pieces, the largest with {len(pieces[0])} of {len(graph.nodes)} "
                "nodes, and between them nobody can navigate. Drive the ways between them too, slowly and both ways "
                "round."
            )


def _one_node(images: int, coverage: MapCoverage) -> str:
    text = "The map has one node, and nobody can navigate by it."
    if coverage.share < LITTLE_KNOWN:
        return text  # Most images show something else; the doubt about the coverage says how many.
    if images < MANY_IMAGES:
        return f"{text} It was built from {images} images of one place; drive farther."
    share = "all" if coverage.share == 1 else "nearly all"
    return (
        f"{text} It is as if {share} {images} images showed one place: does the camera work, and is it the one that "
        "the weights were trained for?"
    )


def _coverage_doubts(coverage: MapCoverage) -> Iterator[str]:
    if coverage.share >= LITTLE_KNOWN:
        return
    text = (
        f"The map knows {coverage.share:.0%} of its own drive: the other images are neither nodes of its largest piece "
        "nor recognised as one, so there the robot will be lost."
    )
    if coverage.gap is None:
        yield f"{text} Drive there again, slowly."
        return
    yield (
        f"{text} The longest such part is from {coverage.gap.begin_s:.1f} s to {coverage.gap.end_s:.1f} s of "
        f"{coverage.gap.drive or 'the drive'}; drive it again, slowly."
    )
