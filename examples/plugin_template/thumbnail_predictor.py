"""A predictor in a package of its own: two images show one place where their thumbnails look alike."""

import numpy as np

import ltvn_core as ltvn

SIDE = 12


class ThumbnailPredictor:
    """Implements `ltvn_core.Predictor`; it knows a place again, but not where in it the camera stood."""

    fingerprint = "thumbnails-1"

    def __init__(self, camera: ltvn.CameraModel) -> None:
        self.camera = camera

    def encode(self, observations: list[ltvn.Observation]) -> np.ndarray:
        """Return (N, SIDE * SIDE) grey values between 0 and 1."""
        rows = [seen.rgb.mean(axis=2) / 255 for seen in observations]
        places = [np.linspace(0, side - 1, SIDE).astype(int) for side in (self.camera.height, self.camera.width)]
        return np.array([row[np.ix_(*places)].ravel() for row in rows]).reshape(-1, SIDE * SIDE)

    def predict(self, sources: np.ndarray, targets: np.ndarray) -> ltvn.Prediction:
        """Compare sources (N, F) or (1, F) with targets (N, F)."""
        apart = np.sqrt(np.mean((targets - sources) ** 2, axis=1))
        return ltvn.Prediction(reachability=np.exp(-10 * apart), waypoints=np.zeros((len(targets), 3)))


def open_thumbnails(request: ltvn.PredictorRequest) -> ThumbnailPredictor:
    """Make one for the camera of a recording, a map or a robot."""
    return ThumbnailPredictor(request.camera)
