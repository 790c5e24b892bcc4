"""What cannot be an edge of a map, and how that is said. Changes nothing."""

import math

from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import Belief, Edge


def check_edge(edge: Edge) -> None:
    """Raise MapError for an edge that cannot be; the words are only made then, for maps are folded from many edges."""
    belief: Belief = edge.belief
    counts = 0 <= edge.successes <= edge.attempts
    if counts and 0 <= belief.p <= 1 and 0 <= belief.mu < math.inf and 0 < belief.sigma2 < math.inf:
        return
    require(0 <= belief.p <= 1, f"{edge_name(edge)} has p = {belief.p}; it must lie in [0, 1].")
    require(0 <= belief.mu < math.inf, f"{edge_name(edge)} has mu = {belief.mu}; it must be finite and not negative.")
    require(0 < belief.sigma2 < math.inf, f"{edge_name(edge)} has sigma2 = {belief.sigma2}; it must be positive.")
    require(counts, f"{edge_name(edge)} counts {edge.successes} successes in {edge.attempts} attempts.")


def edge_name(edge: Edge) -> str:
    """Name an edge in an error."""
    return f"Edge {edge.source} -> {edge.target}"


def require(holds: bool, otherwise: str) -> None:
    """Raise MapError with these words unless something holds."""
    if not holds:
        raise MapError(otherwise)
