"""The option that names a predictor. Owns nothing but its type, which lists the predictors that are installed."""

from typing import TYPE_CHECKING, Literal, TypeAlias

from ltvn_core.plugins import PREDICTORS, find_plugins

AUTO = "auto"
"""As in `ltvn_core.predictors.choice`, which would bring numpy into every `--help`."""

if TYPE_CHECKING:
    PredictorName: TypeAlias = str
else:
    PredictorName = Literal[(AUTO, *find_plugins(PREDICTORS, first=("network", "geometric", "oracle")))]
