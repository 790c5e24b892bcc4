"""The names of what driving may teach a map. Owns the names alone, so that listing them costs nothing."""

from typing import Literal, TypeAlias, get_args

MaintenanceName: TypeAlias = Literal["static", "paper", "robust", "brm", "brm-rooms", "persistent", "truth"]
"""`static`: the map stays as it was built. `paper`: Eq. 3, Eq. 4 and pruning as in the paper. `robust`: the same as in
the default preset. `brm`: the posterior of BRM, which prunes and adds nothing. `brm-rooms`: the same of ways between
rooms, which the simulator names. `persistent`: as robust, but what stands in the way is a matter of presence. `truth`:
the same with what the world knows, in simulation."""

MAINTENANCE_NAMES: tuple[str, ...] = get_args(MaintenanceName)
"""All of them, in the order of tables."""
