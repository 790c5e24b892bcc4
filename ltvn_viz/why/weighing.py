"""What edges cost in the run on show: as the system weighs them that planned in it. Owns what is said about it."""

from typing import NamedTuple, get_args

from ltvn_core.analysis.imagined import Weights, ltvn_weights
from ltvn_core.composition import SystemName, open_system
from ltvn_viz.why.case import Case


class Weighing(NamedTuple):
    """How the system that planned weighs edges."""

    weights: Weights
    note: str
    """What a person should know about it; mostly nothing."""


def weighing(case: Case) -> Weighing:
    """Return how edges are weighed in a run: as its recording says, else as the paper's own system does."""
    if case.is_live or case.system == "ltvn":
        return Weighing(ltvn_weights, "")
    name: SystemName | None = next((each for each in get_args(SystemName) if each == case.system), None)
    if name is not None:
        return Weighing(lambda method: open_system(name, method).edge_weight, f"Both plans weigh edges as {name} does.")
    named = f"names the system “{case.system}”, which is not known here" if case.system else "names no system"
    return Weighing(ltvn_weights, f"The recording {named}; both plans weigh edges as ltvn does.")
