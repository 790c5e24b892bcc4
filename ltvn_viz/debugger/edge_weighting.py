"""Costs of edges in the current run, by the weights of the system that planned in it. Owns the description of them."""

from typing import NamedTuple

from ltvn_core.analysis.what_if_scenario import EdgeWeightFactory, ltvn_edge_weight
from ltvn_core.systems.registry import DEFAULT_SYSTEM, known_system
from ltvn_viz.debugger.context import DebugContext


class EdgeWeighting(NamedTuple):
    """Edge weights of the navigation system that planned."""

    edge_weight_of: EdgeWeightFactory
    note: str
    """A note for the person; usually empty."""


def edge_weighting(context: DebugContext) -> EdgeWeighting:
    """Return the edge weights of a run: those of the system that planned in it, or else those of the paper."""
    entry = known_system(context.system)
    if entry is not None:
        note = "" if entry.name == DEFAULT_SYSTEM else f"Both plans use the edge costs of {entry.name}."
        return EdgeWeighting(lambda method: entry.factory(method).edge_weight, note)
    named = f"names the system “{context.system}”, which is not known here" if context.system else "names no system"
    return EdgeWeighting(ltvn_edge_weight, f"The recording {named}; both plans use the edge costs of {DEFAULT_SYSTEM}.")
