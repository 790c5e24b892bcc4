"""The option that names the simulated robot's body, apart from the others so that `ltvn build` reaches no simulator."""

from typing import Annotated, TypeAlias

import tyro

from ltvn_core.simulation.body_names import BodyName

BodyOption: TypeAlias = Annotated[
    BodyName,
    tyro.conf.arg(
        help="The simulated robot's body: bullet uses PyBullet's physics, planar is a disc without PyBullet; "
        "auto uses bullet if PyBullet is installed."
    ),
]
"""A verb gives it the default "auto"."""
