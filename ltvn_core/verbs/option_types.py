"""Types of options that several verbs use: installed systems and predictors by name."""

from typing import TYPE_CHECKING, Literal, TypeAlias

from ltvn_core.plugins import PREDICTORS, find_plugins
from ltvn_core.systems.registry import system_names

AUTO = "auto"
"""Same value as in `ltvn_core.predictors.choice`, which would import numpy for every `--help`."""

if TYPE_CHECKING:
    SystemName: TypeAlias = str
    PredictorName: TypeAlias = str
else:
    SystemName = Literal[system_names()]
    PredictorName = Literal[(AUTO, *find_plugins(PREDICTORS, first=("network", "geometric", "oracle")))]
