"""Ablations: the method without single parts, expressed as thresholds that switch them off.

Fine-tuning is not among them, because it is a property of the weights.
"""

from collections.abc import Callable, Collection
from dataclasses import fields, replace

from ltvn_core.config import PAPER, Method
from ltvn_core.errors import OptionError


def without_parts(method: Method, parts: Collection[str]) -> Method:
    """Return the method without these parts; raise OptionError, listing the valid ones, for an unknown part."""
    for part in sorted(parts):
        if part not in PARTS:
            raise OptionError(f"The method has no part {part!r} to leave out; choose from: {', '.join(PARTS)}.")
        method = PARTS[part](method)
    return method


def _without_merging(method: Method) -> Method:
    """Make every image that can be connected a node: D_m = 0."""
    return replace(method, building=replace(method.building, merge_distance=0.0))


def _without_pruning(method: Method) -> Method:
    """Remove no edge, however low its p: R_p = 0."""
    return replace(method, believing=replace(method.believing, prune_below=0.0, hindered_prune_below=0.0))


def _without_expansion(method: Method) -> Method:
    """Add no nodes while navigating."""
    return replace(method, expanding=replace(method.expanding, novel_after_looks=0, search_reserve=False))


def _as_in_paper(group: str) -> Callable[[Method], Method]:
    """Return a change that sets one group of thresholds to the paper's; limits and measured constants stay."""

    def plain(method: Method) -> Method:
        own = getattr(method, group)
        paper = getattr(PAPER, group)
        kept = {field.name: getattr(own, field.name) for field in fields(own) if field.name in _KEPT_FIELDS}
        return replace(method, **{group: replace(paper, **kept)})

    return plain


_KEPT_FIELDS = frozenset(
    {"step_limit", "collision_limit", "p_success_if_reachable", "p_success_if_not", "sigma2", "search_reserve"}
)

PARTS: dict[str, Callable[[Method], Method]] = {
    "merging": _without_merging,
    "pruning": _without_pruning,
    "expansion": _without_expansion,
    **{f"our-{field.name}": _as_in_paper(field.name) for field in fields(Method) if field.name != "maintain"},
}
"""What can be left out, by the names the command line knows; `our-driving` leaves out our departures in driving."""
