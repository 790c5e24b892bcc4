"""Options of several verbs: systems and predictors by name, as they are installed, and the simulated robot's body."""

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import tyro

from ltvn_core.plugins import PREDICTORS, find_plugins
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.systems.registry import system_names

AUTO = "auto"
"""As in `ltvn_core.predictors.choice`, which would bring numpy into every `--help`."""

if TYPE_CHECKING:
    SystemName: TypeAlias = str
    PredictorName: TypeAlias = str
else:
    SystemName = Literal[system_names()]
    PredictorName = Literal[(AUTO, *find_plugins(PREDICTORS, first=("network", "geometric", "oracle")))]

BodyOption: TypeAlias = Annotated[
    BodyName,
    tyro.conf.arg(
        help="The simulated robot's body: bullet is PyBullet's physics, planar a disc that needs no PyBullet; auto "
        "takes bullet where PyBullet is installed."
    ),
]
"""A verb gives it the default "auto"."""
