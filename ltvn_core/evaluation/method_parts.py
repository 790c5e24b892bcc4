"""The method without single parts, which are switched off by thresholds.

Fine-tuning can be left out as well; it is a setting of a plan, because it is a property of the weights.
"""

from collections.abc import Callable, Collection
from dataclasses import fields, replace

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.errors import OptionError

FINE_TUNING = "fine-tuning"


def without_parts(method: Method, parts: Collection[str]) -> Method:
    """Return the method without these parts; raise OptionError, listing the valid ones, for an unknown part."""
    for part in sorted(parts):
        change = PARTS.get(part) or RULES.get(part)
        if change is None:
            raise OptionError(
                f"The method has no part {part!r} to leave out; choose from: {', '.join(PARTS)}; or one rule: "
                f"{', '.join(RULES)}."
            )
        method = change(method)
    return method


def _without_merging(method: Method) -> Method:
    """Make every image that can be connected a node: D_m = 0."""
    return replace(method, building=replace(method.building, merge_distance=0.0))


def _without_pruning(method: Method) -> Method:
    """Prune no edge, even with a low p: R_p = 0."""
    return replace(method, believing=replace(method.believing, prune_below=0.0))


def _without_expansion(method: Method) -> Method:
    """Add no nodes during navigation."""
    return replace(method, expanding=replace(method.expanding, novel_after_looks=0, search_reserve=False))


def _as_in_paper(group: str, names: Collection[str]) -> Callable[[Method], Method]:
    """Return a function that sets some thresholds of a group to the paper's."""
    paper = {name: getattr(getattr(PAPER, group), name) for name in names}

    def plain(method: Method) -> Method:
        return replace(method, **{group: replace(getattr(method, group), **paper)})

    return plain


_KEPT_FIELDS = frozenset(
    {"step_limit", "collision_limit", "p_success_if_reachable", "p_success_if_not", "sigma2", "search_reserve"}
)


def _thresholds(group: str) -> list[str]:
    """Return the names of a group's thresholds, without limits and measured constants."""
    return [each.name for each in fields(getattr(ROBUST, group)) if each.name not in _KEPT_FIELDS]


def _departures(group: str) -> list[str]:
    """Return the names of a group's thresholds whose value differs from the paper's."""
    ours, paper = getattr(ROBUST, group), getattr(PAPER, group)
    return [name for name in _thresholds(group) if getattr(ours, name) != getattr(paper, name)]


_GROUPS = tuple(field.name for field in fields(Method) if field.name != "maintain")

PARTS: dict[str, Callable[[Method], Method]] = {
    "merging": _without_merging,
    "pruning": _without_pruning,
    "expansion": _without_expansion,
    **{f"our-{group}": _as_in_paper(group, _thresholds(group)) for group in _GROUPS},
}
"""Parts that can be switched off, by their names on the command line. `our-driving` stands for all our changes to the
paper's driving."""
RULES = {f"{group}.{name}": _as_in_paper(group, [name]) for group in _GROUPS for name in _departures(group)}
"""Each of our changes to the paper by itself, such as "driving.swerve"; the command line also accepts these names."""


def method_parts() -> tuple[str, ...]:
    """Return the names of the parts that can be switched off."""
    return (*PARTS, FINE_TUNING, *RULES)
