"""Names of the simulated robot's bodies, in a module of their own that the command line can import quickly."""

from typing import Literal, TypeAlias

BodyName: TypeAlias = Literal["auto", "bullet", "planar"]
"""`auto` is Bullet if PyBullet is installed, else planar."""
KnownBody: TypeAlias = Literal["bullet", "planar"]
"""Name of a chosen body."""
