"""The names of harder conditions for evaluations. Owns only the names, so that the module is quick to import."""

from typing import Literal, TypeAlias, get_args

ConditionName: TypeAlias = Literal["slip", "one-loop", "half-light"]
"""`slip`: the wheels slip, in the mapping drive and in the episodes. `one-loop`: the mapping drive has only one loop.
`half-light`: the map is made in full light, and the episodes are driven at half of that brightness."""

CONDITION_NAMES: tuple[str, ...] = get_args(ConditionName)
"""Names of all conditions, in the order of the tables."""
