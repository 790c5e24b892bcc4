"""Third-party models in ONNX format: policies such as GNM, ViNT and NoMaD, and place descriptors.

A policy predicts the distance to the target in steps and a path; they are converted to r and a waypoint. A place
descriptor proposes pairs, which `geometric` verifies. The model's card describes its inputs and outputs
(`predictors.onnx_card`). Nothing is downloaded. Implements `ltvn_core.types.Predictor`.
"""

import hashlib
import math
from collections.abc import Sequence
from threading import Event, Timer

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import WeightsError
from ltvn_core.predictors.composed import ComposedPredictor
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.onnx_card import OnnxCard, read_onnx_card
from ltvn_core.predictors.onnx_files import model_contents
from ltvn_core.predictors.request import PredictorRequest
from ltvn_core.types import Features, Observation, Prediction, Predictor

_AT_ONCE = 64
"""Number of pairs or images per call of the model."""
_TRIAL_S = 60.0
"""Time in which a model must answer one row when it is opened, in seconds."""
_MOST_S = 600.0
"""Time in which it must answer any call, in seconds."""
_SHARPNESS = 5.0
"""Slope of the logistic function by which r falls from nearly 1 at distance 0 to 0.5 at `reachable_below`."""
_SAME_PLACE_SLOPE = 20.0
_LEAST_R, _MOST_R = 0.001, 0.999
"""Limits of r; never 0 or 1, because Eq. 3 could never revise that."""

Array = NDArray[np.float32]


def open_onnx(request: PredictorRequest) -> Predictor:
    """Open the model whose card the request names as weights. Raises WeightsError and MissingLibraryError."""
    if request.weights is None:
        raise WeightsError("The predictor `onnx` needs a model: name its card with --weights CARD.toml.")
    card = read_onnx_card(request.weights)
    model = OnnxModel(card)
    if card.is_descriptor:
        return ComposedPredictor(OnnxDescriptor(card, model), GeometricPredictor(request.camera, shortlist_from=None))
    return OnnxPolicy(card, model, request.camera)


class OnnxModel:
    """A model on the CPU, with the inputs and outputs of its card."""

    def __init__(self, card: OnnxCard, *, most_s: float = _TRIAL_S) -> None:
        """Load the model and try it. Raises WeightsError if it is missing, damaged, has other inputs or outputs, or
        answers for no image within `most_s` seconds."""
        self.fingerprint = f"onnx-{_digest(card)}"
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4  # Errors are raised, so they need not be logged as well.
        options.inter_op_num_threads = 1
        try:
            self._session = onnxruntime.InferenceSession(str(card.model), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # The exceptions of its compiled module have no other common class.
            raise WeightsError(
                f"{card.model}: is not an ONNX model that can be loaded ({_first_line(error)})."
            ) from error
        has_inputs = [each.name for each in self._session.get_inputs()]
        has_outputs = [each.name for each in self._session.get_outputs()]
        inputs, self._outputs = card.names
        if set(inputs) != set(has_inputs) or not set(self._outputs) <= set(has_outputs):
            raise WeightsError(
                f"{card.model}: takes {', '.join(has_inputs)} and gives {', '.join(has_outputs)}; the card names "
                f"{', '.join(inputs)} and {', '.join(self._outputs)}."
            )
        self._path = card.model
        width, height = card.size
        depth = {card.source: 3 * (card.context + 1)}
        self.run({name: np.zeros((1, depth.get(name, 3), height, width), np.float32) for name in inputs}, most_s=most_s)

    def run(self, inputs: dict[str, Array], *, most_s: float = _MOST_S) -> dict[str, Array]:
        """Return the card's outputs for inputs of N rows each. Raises WeightsError if shapes do not fit, or if it takes
        longer than `most_s` seconds."""
        count = len(next(iter(inputs.values())))
        options = onnxruntime.RunOptions()
        options.log_severity_level = 4
        is_late = Event()

        def end() -> None:
            is_late.set()
            options.terminate = True

        timer = Timer(most_s, end)
        timer.daemon = True
        timer.start()
        try:
            found = self._session.run(self._outputs, inputs, options)
        except Exception as error:  # See above.
            if is_late.is_set():
                raise WeightsError(
                    f"{self._path}: gives no answer for {count} rows within {most_s:g} s; if it has an endless loop, "
                    "export it anew, otherwise use a smaller model."
                ) from error
            shapes = ", ".join(f"{name} {each.shape}" for name, each in inputs.items())
            raise WeightsError(f"{self._path}: refuses {shapes} ({_first_line(error)}).") from error
        finally:
            timer.cancel()
        outputs = {name: np.asarray(each, np.float32) for name, each in zip(self._outputs, found, strict=True)}
        for name, each in outputs.items():
            if each.ndim == 0 or len(each) != count or not np.isfinite(each).all():
                raise WeightsError(f"{self._path}: gives {name} of shape {each.shape} or not finite for {count} rows.")
        return outputs


class OnnxPolicy:
    """A policy as a predictor. Its features are the preprocessed images, (N, 3 * height * width)."""

    def __init__(self, card: OnnxCard, model: OnnxModel, camera: CameraModel) -> None:
        """Compare images of `camera` with `model`."""
        self._card = card
        self._model = model
        self.camera = camera
        self.fingerprint = model.fingerprint

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, F) images, resized and normalised for the model."""
        images = prepared_images(observations, self._card)
        return images.reshape(len(images), math.prod(images.shape[1:]))

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) or (1, F) with targets (N, F)."""
        parts = [
            self._predict(sources if len(sources) == 1 else sources[k : k + _AT_ONCE], targets[k : k + _AT_ONCE])
            for k in range(0, len(targets), _AT_ONCE)
        ]
        if not parts:
            return Prediction(np.empty(0), np.empty((0, 3)))
        return Prediction(np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts]))

    def _predict(self, sources: Features, targets: Features) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        card = self._card
        width, height = card.size
        shape = (len(targets), 3, height, width)
        source = np.broadcast_to(sources, targets.shape).astype(np.float32).reshape(shape)
        # A map contains single images, so the source is repeated, as if the robot had not moved.
        history = np.tile(source, (1, card.context + 1, 1, 1))
        found = self._model.run({card.source: history, card.target: targets.astype(np.float32).reshape(shape)})
        rows = {name: np.asarray(each, np.float64).reshape(len(targets), -1) for name, each in found.items()}
        steps = rows[card.distance][:, 0] if card.distance else None
        return self._reachability(rows, steps), self._waypoints(found, rows, steps)

    def _reachability(
        self, rows: dict[str, NDArray[np.float64]], steps: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        if self._card.reachability:
            r = rows[self._card.reachability][:, 0]
        else:
            assert steps is not None, "the card must have one of the two"
            r = _logistic(_SHARPNESS * (1 - steps / self._card.reachable_below))
        return np.clip(r, _LEAST_R, _MOST_R)

    def _waypoints(
        self, found: dict[str, Array], rows: dict[str, NDArray[np.float64]], steps: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Return waypoints (N, 3): the predicted pose or, without one, the end of the path, scaled to the distance."""
        card = self._card
        if card.pose:
            pose = rows[card.pose]
            return np.column_stack([pose[:, :2] * card.waypoint_m, pose[:, 2]])
        way = np.asarray(found[card.waypoints], np.float64)
        if way.ndim != 3 or way.shape[2] not in (2, 4):
            raise WeightsError(
                f"{card.model}: gives {card.waypoints} of shape {way.shape}, not (N, T, 2) or (N, T, 4)."
            )
        last = way[:, -1, :2] * card.waypoint_m
        length = np.hypot(last[:, 0], last[:, 1])
        if steps is not None:
            last = last * (np.maximum(steps, 0) * card.distance_m / np.maximum(length, 1e-6))[:, None]
        heading = np.arctan2(way[:, -1, 3], way[:, -1, 2]) if way.shape[2] == 4 else np.arctan2(last[:, 1], last[:, 0])
        return np.column_stack([last, heading])


class OnnxDescriptor:
    """A place descriptor. Implements `ltvn_core.predictors.composed.Recogniser`."""

    def __init__(self, card: OnnxCard, model: OnnxModel) -> None:
        """Describe images with `model`."""
        self._card = card
        self._model = model
        self.fingerprint = model.fingerprint

    def describe(self, observations: Sequence[Observation]) -> NDArray[np.float32]:
        """Return unit vectors (N, D)."""
        images = prepared_images(observations, self._card)
        parts = [
            self._model.run({self._card.image: images[k : k + _AT_ONCE]})[self._card.embedding]
            for k in range(0, len(images), _AT_ONCE)
        ]
        found = np.concatenate([part.reshape(len(part), -1) for part in parts] or [np.empty((0, 0), np.float32)])
        return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-6)

    def same_place(self, sources: NDArray[np.float32], targets: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the probability (N,) that two images show one place, for (N, D) or (1, D) against (N, D)."""
        similarity = np.einsum("nd,nd->n", *np.broadcast_arrays(sources, targets)).astype(np.float64)
        return _logistic(_SAME_PLACE_SLOPE * (similarity - self._card.same_place_above))


def prepared_images(observations: Sequence[Observation], card: OnnxCard) -> Array:
    """Return images (N, 3, height, width), resized and normalised for a model."""
    small = [cv2.resize(seen.rgb, card.size, interpolation=cv2.INTER_AREA) for seen in observations]
    images = np.stack(small).astype(np.float32) / 255 if small else np.empty((0, card.size[1], card.size[0], 3))
    return np.ascontiguousarray(((images - card.mean) / card.std).transpose(0, 3, 1, 2), np.float32)


def _logistic(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return 1 / (1 + np.exp(-np.clip(x, -50, 50)))


def _digest(card: OnnxCard) -> str:
    """Return a hash of the model, the data beside it, and the other fields of its card."""
    said = repr({name: getattr(card, name) for name in card.__slots__ if name != "model"})
    model, *data = model_contents(card.model)
    digest = hashlib.sha256(model)
    for part in (said.encode(), *data):
        digest.update(part)
    return digest.hexdigest()[:12]


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0][:200] if str(error).strip() else type(error).__name__
