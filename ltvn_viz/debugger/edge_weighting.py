"""What edges cost in the run on show: as the system weighs them that planned in it. Owns what is said about it."""

from typing import NamedTuple, get_args

from ltvn_core.analysis.what_if_scenario import EdgeWeightFactory, ltvn_edge_weight
from ltvn_core.composition import SystemName, open_system
from ltvn_viz.debugger.context import DebugContext


class EdgeWeighting(NamedTuple):
    """How the system that planned weighs edges."""

    edge_weight_of: EdgeWeightFactory
    note: str
    """What a person should know about it; mostly nothing."""


def edge_weighting(context: DebugContext) -> EdgeWeighting:
    """Return how edges are weighed in a run: as its recording says, else as the paper's own system does."""
    if context.is_live or context.system == "ltvn":
        return EdgeWeighting(ltvn_edge_weight, "")
    name: SystemName | None = next((each for each in get_args(SystemName) if each == context.system), None)
    if name is not None:
        return EdgeWeighting(
            lambda method: open_system(name, method).edge_weight, f"Both plans weigh edges as {name} does."
        )
    named = f"names the system “{context.system}”, which is not known here" if context.system else "names no system"
    return EdgeWeighting(ltvn_edge_weight, f"The recording {named}; both plans weigh edges as ltvn does.")
