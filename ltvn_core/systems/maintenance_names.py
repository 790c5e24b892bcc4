"""The names of maintenance strategies, in a module without imports, so that listing them is fast."""

from typing import Literal, TypeAlias, get_args

MaintenanceName: TypeAlias = Literal["static", "paper", "robust", "brm", "brm-rooms", "persistent", "truth"]
"""Name of a maintenance strategy.

`static`: the map stays as it was built. `paper`: Eq. 3, Eq. 4 and pruning as in the paper. `robust`: the same as in the
default preset. `brm`: the posterior of BRM, which prunes and adds nothing. `brm-rooms`: the same for connections
between rooms, which the simulator names. `persistent`: as `robust`, but obstacles change the presence of edges and not
their existence. `truth`: as `persistent`, with presence from the ground truth of the simulation."""

MAINTENANCE_NAMES: tuple[str, ...] = get_args(MaintenanceName)
"""All names, in the order of tables."""
