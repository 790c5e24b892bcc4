"""Opens the simulator's own geometry as the predictor `oracle`."""

from ltvn_core.predictors.request import PredictorRequest
from ltvn_core.simulation.oracle_predictor import OraclePredictor
from ltvn_core.simulation.scene_registry import load_scene


def open_oracle(request: PredictorRequest) -> OraclePredictor:
    """Return the oracle for the scene's clearance map. Raises SceneError if the scene is not simulated."""
    return OraclePredictor(load_scene(request.scene).clearance, request.camera)
