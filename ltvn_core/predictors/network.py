"""Opens the trained network as the predictor `network`."""

from ltvn_core.network.predictor import NetworkPredictor, load_predictor
from ltvn_core.predictors.request import PredictorRequest


def open_network(request: PredictorRequest) -> NetworkPredictor:
    """Open the weights of the request, or the shipped ones if it names none. Raises WeightsError."""
    return load_predictor(request.weights, device=request.device)
