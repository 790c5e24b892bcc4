"""What is doubtful of a map as a whole, in words. Decides nothing: such a map is kept and can be driven by."""

from ltvn_core.graph.topological_graph import TopologicalGraph

MANY_IMAGES = 20
"""From so many images on a map of one node is doubtful; a drive of two metres has as many."""


def map_doubts(graph: TopologicalGraph, images: int) -> tuple[str, ...]:
    """Return what is doubtful of a map that was built from so many images; nothing for a map that is in order."""
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
    return ()
