"""Names of the simulated robot's bodies; light, because the command line reads them."""

from typing import Literal, TypeAlias

BodyName: TypeAlias = Literal["auto", "bullet", "planar"]
"""`auto` is Bullet where PyBullet is installed, and planar elsewhere."""
KnownBody: TypeAlias = Literal["bullet", "planar"]
"""A body that was chosen."""
