"""Opens the composed predictor: EfficientNet proposes places, and `geometric` verifies them. Needs the extra
`place`."""

from ltvn_core.network.place_recogniser import EfficientNetRecogniser
from ltvn_core.predictors.composed import ComposedPredictor
from ltvn_core.predictors.geometric import GeometricPredictor, requested_calibration
from ltvn_core.predictors.request import PredictorRequest


def open_composed(request: PredictorRequest) -> ComposedPredictor:
    """Return the predictor for the request's camera; weights may name a drive's calibration. Raises WeightsError."""
    poser = GeometricPredictor(request.camera, calibration=requested_calibration(request), shortlist_from=None)
    return ComposedPredictor(EfficientNetRecogniser(), poser)
