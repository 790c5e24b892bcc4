"""The composed predictor by name: EfficientNet's place descriptors propose, geometry confirms. An extra, `place`."""

from ltvn_core.network.place_recogniser import EfficientNetRecogniser
from ltvn_core.predictors.composed import ComposedPredictor
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.request import PredictorRequest


def open_composed(request: PredictorRequest) -> ComposedPredictor:
    """Take the camera of the request as it is."""
    return ComposedPredictor(EfficientNetRecogniser(), GeometricPredictor(request.camera, shortlist_from=None))
