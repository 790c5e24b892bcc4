"""Predictors by name: entry points of the group `ltvn.predictors`, each a function from a `PredictorRequest`.

Owns the order of the names and the checks of what a factory makes. Which one is taken where nobody names one is
`ltvn_core.predictors.choice`'s.
"""

from typing import cast

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import LtvnError, OptionError, PluginError
from ltvn_core.extras import naming_the_extra
from ltvn_core.plugins import PREDICTORS, Plugin, find_plugins, require_own
from ltvn_core.predictors.request import PredictorFactory, PredictorRequest
from ltvn_core.types import Predictor

NETWORK = "network"
GEOMETRIC = "geometric"
COMPOSED = "composed"
ORACLE = "oracle"

OWN_PREDICTORS = (NETWORK, GEOMETRIC, ORACLE)
"""Those of this package that come first in lists."""


def find_predictors() -> dict[str, Plugin]:
    """Return the installed predictors by name; nothing is imported."""
    return find_plugins(PREDICTORS, first=OWN_PREDICTORS)


def predictor_names() -> tuple[str, ...]:
    """Return the names of all predictors."""
    return tuple(find_predictors())


def require_predictor(name: str) -> Plugin:
    """Return the plug-in of that name. Raises OptionError with the names there are."""
    found = find_predictors()
    if name not in found:
        require_own(PREDICTORS, name, OWN_PREDICTORS)
        raise OptionError(
            f"No predictor is called {name!r}; installed are: {', '.join(found) or 'none'}. Install the package that "
            "brings it, or name another."
        )
    return found[name]


def open_plugin(plugin: Plugin, request: PredictorRequest) -> Predictor:
    """Import a predictor's factory, call it, and check what it makes.

    Raises PluginError for a broken plug-in, and what the factory raises where the request is at fault.
    """
    factory = plugin.load()
    if not callable(factory):
        raise plugin.refusal("is no function from a PredictorRequest to a Predictor")
    try:
        with naming_the_extra():
            made = cast(PredictorFactory, factory)(request)
    except LtvnError:
        raise
    except Exception as error:  # Another package's code may raise anything.
        raise PluginError(
            f"{plugin.title} could not be opened ({type(error).__name__}: {error}); {plugin.remedy}."
        ) from error
    check_predictor(made, plugin)
    return made


def check_predictor(made: object, plugin: Plugin) -> None:
    """Raise PluginError where a part of the Protocol `Predictor` is missing."""
    missing = [name for name in ("encode", "predict") if not callable(getattr(made, name, None))]
    fingerprint, camera = getattr(made, "fingerprint", None), getattr(made, "camera", None)
    if not (isinstance(fingerprint, str) and fingerprint):
        missing.append("fingerprint (a text)")
    if not isinstance(camera, CameraModel):
        missing.append("camera (a CameraModel)")
    if missing:
        raise plugin.refusal(
            f"makes {type(made).__name__}, and that has no {', '.join(missing)}; see ltvn_core.types.Predictor"
        )
