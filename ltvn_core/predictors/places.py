"""The composed predictor by name: EfficientNet's place descriptors propose, geometry confirms. An extra, `place`."""

from ltvn_core.network.place_recogniser import EfficientNetRecogniser
from ltvn_core.predictors.composed import ComposedPredictor
from ltvn_core.predictors.geometric import GeometricPredictor, requested_calibration
from ltvn_core.predictors.request import PredictorRequest


def open_composed(request: PredictorRequest) -> ComposedPredictor:
    """Take the camera of the request as it is, and a drive's own calibration as weights. Raises WeightsError."""
    poser = GeometricPredictor(request.camera, calibration=requested_calibration(request), shortlist_from=None)
    return ComposedPredictor(EfficientNetRecogniser(), poser)
