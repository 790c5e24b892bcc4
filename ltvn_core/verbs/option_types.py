"""Options of several verbs: systems and predictors by name, as they are installed."""

from typing import TYPE_CHECKING, Literal, TypeAlias

from ltvn_core.plugins import PREDICTORS, find_plugins
from ltvn_core.systems.registry import system_names

AUTO = "auto"
"""The same value as in `ltvn_core.predictors.choice`, which would import numpy for every `--help`."""

if TYPE_CHECKING:
    SystemName: TypeAlias = str
    PredictorName: TypeAlias = str
else:
    SystemName = Literal[system_names()]
    PredictorName = Literal[(AUTO, *find_plugins(PREDICTORS, first=("network", "geometric", "oracle")))]
