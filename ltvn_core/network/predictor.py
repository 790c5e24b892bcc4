"""The predictor: a network with numpy arrays as inputs and outputs, deterministic and in bounded memory.

Adds batching, checks of the input, and the prefilter for one source with many targets. Implements `types.Predictor`.

For a few pairs half of the time is overhead of Python, so the comparison is traced once by TorchScript: the trace runs
the same operations in the same order, and its results are bit-identical.
"""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ltvn_core.config import Likelihoods
from ltvn_core.errors import ImageError
from ltvn_core.network.allocator import retain_freed_memory
from ltvn_core.network.architecture import NETWORK_CAMERA, AnyArchitecture
from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.device import CPU, RowsOnDevice, choose_device, device_of, limit_threads, to_tensor
from ltvn_core.network.driving_calibration import measured_likelihoods
from ltvn_core.network.image_features import may_match
from ltvn_core.network.image_features import pack as pack_features
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.weights_file import load_weights, weights_fingerprint
from ltvn_core.types import Features, HeldFeatures, Observation, Prediction

_CALLS_BEFORE_RECORDING = 20
"""Calls before the comparison is traced, because tracing takes as long as a hundred small comparisons."""


class Comparison:
    """Compares pairs with a network, traced after some calls; call it in inference mode."""

    def __init__(self, network: AnyNetwork) -> None:
        """Compare with `network`, whose weights may still change, but not its layers."""
        self._steps = _ComparisonSteps(network).eval()
        self._recorded: torch.jit.ScriptModule | None = None
        self._may_record = network.is_traceable
        self._calls = 0

    def __call__(self, sources: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Return reachability (P,) and poses (P, 4) for rows (P, F) or (1, F) and (P, F)."""
        self._calls += 1
        if self._recorded is None and self._may_record and self._calls > _CALLS_BEFORE_RECORDING:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # It recommends alternatives that need a compiler and take minutes.
                recorded = torch.jit.trace(self._steps, (sources, targets), check_trace=False)
            assert isinstance(recorded, torch.jit.ScriptModule)
            self._recorded = recorded
        return (self._recorded or self._steps)(sources, targets)


class _ComparisonSteps(nn.Module):
    """Module from feature rows to reachability and pose."""

    def __init__(self, network: AnyNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, sources: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Return reachability (P,) and poses (P, 4) for rows (P, F) or (1, F) and (P, F)."""
        here = self.network.unpack(sources)
        there = self.network.unpack(targets)
        here = here._make([part.expand(targets.shape[0], *part.shape[1:]) for part in here])
        output = self.network.compare(here, there)
        return self.network.reachability(output.logit), output.pose


PREFILTER_FROM = 200
"""Number of targets from which on a single source is compared in full only with the most similar ones."""
PREFILTER_KEEP = 96
"""Number of targets that the prefilter keeps for the full comparison."""
PLACE_KEEP, _PLACE_SHARE = 2_000, 0.05
"""Number of targets that are kept by place score for the prefilter, and the share of all targets, if that is more.

Among 5,100 images of two apartments, the best node for each of 90 images was always among the first 241 by place score.
"""

_AT_ONCE, _AT_ONCE_ON_CARD = (64, 256), (256, 1024)
"""Numbers of images and of pairs in a batch; on a graphics card up to 256 pairs take as long as one."""
_FEATURES, _KEYS = 0, 1


class NetworkPredictor:
    """The predictor f(o_i, o_j) -> (r, dx, dy, dtheta) of a trained network."""

    def __init__(
        self,
        network: AnyNetwork,
        fingerprint: str,
        *,
        prefilter_from: int | None = PREFILTER_FROM,
        weights: Path | None = None,
        as_on_card: bool | None = None,
    ) -> None:
        """Use a trained network; `prefilter_from` None compares every pair in full.

        The card beside `weights` has the constants that were measured for it. `as_on_card` says whether to keep the
        features of maps on the device and to work in larger batches; None does so except on the CPU.
        """
        self._network = network.eval()
        self._compare = Comparison(network)
        self._device = device_of(network)
        on_card = self._device.type != "cpu" if as_on_card is None else as_on_card
        self._images_at_once, self._pairs_at_once = _AT_ONCE_ON_CARD if on_card else _AT_ONCE
        self.kept = (RowsOnDevice(self._device), RowsOnDevice(self._device)) if on_card else None
        """Features and keys of maps on the device; None on the CPU."""
        self.fingerprint = fingerprint
        """Fingerprint of the weights."""
        self._prefilter_from = prefilter_from
        self._weights = weights

    needs_depth = True
    """Depth is required, because matching and alignment use the 3D points of tokens."""

    camera = NETWORK_CAMERA
    """The camera of the input images: 96 x 72 pixels, 69.4 degrees wide, level."""

    @property
    def likelihoods(self) -> Likelihoods | None:
        """The constants of Eq. 3 and Eq. 4 measured for these weights; None if not measured. Raises WeightsError."""
        return None if self._weights is None else measured_likelihoods(self._weights)

    @property
    def device(self) -> str:
        """Kind of device that computes: cpu, cuda or mps."""
        return self._device.type

    @property
    def architecture(self) -> AnyArchitecture:
        """Return the sizes of the network."""
        return self._network.size

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, F) float16 features.

        Raises ImageError for observations of another size than the camera's, and for observations without depth.
        """
        parts = [np.empty((0, self._network.row_length), np.float16)]
        for first in range(0, len(observations), self._images_at_once):
            batch = [_checked(each) for each in observations[first : first + self._images_at_once]]
            depth = np.stack([each.require_depth("the network") for each in batch])
            parts.append(self._encode(np.stack([each.rgb for each in batch]), depth))
        return np.concatenate(parts)

    def encode_images(self, rgb: NDArray[np.uint8], depth_mm: NDArray[np.uint16]) -> Features:
        """Return (N, F) float16 features of images (N, H, W, 3) with depth in millimetres (N, H, W)."""
        parts = [slice(first, first + self._images_at_once) for first in range(0, len(rgb), self._images_at_once)]
        return np.concatenate([self._encode(rgb[part], depth_mm[part] / np.float32(1000)) for part in parts])

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, F) or (1, F) with targets (N, F).

        One source with many targets (200 or more, unless the prefilter is off or the network has no cheap score) is
        compared in full only with the 96 most similar ones. The others get a rough reachability, at most the lowest
        of the full comparisons, and a waypoint of zeros that has no meaning.
        """
        self._check(sources, targets)
        if len(sources) == 1 and self._is_filtered(len(targets)):
            keys = self.place_keys(targets)
            if keys is not None:
                return self._predict_filtered(sources, HeldFeatures(targets, keys, np.arange(len(targets))))
        return self._predict(sources, targets)

    def place_keys(self, features: Features) -> NDArray[np.float32] | None:
        """Return the keys (N, K) of images (N, F) for `predict_among`; None if the network has no cheap score."""
        return self._network.place_keys(features)

    def predict_among(self, source: Features, held: HeldFeatures) -> Prediction:
        """Compare a source (1, F) with N stored images, as `predict` does; few of their features are read."""
        self._check(source, held.features)
        if self._is_filtered(len(held.rows)):
            return self._predict_filtered(source, held)
        features, rows = self._features(held, held.rows)
        return self._predict(source, features[rows])

    @torch.inference_mode()
    def predict_rows(self, features: Features, sources: NDArray[np.intp], targets: NDArray[np.intp]) -> Prediction:
        """Compare pairs of rows (P,) and (P,) of features (N, F), which are moved to the device only once."""
        rows, first, second = (self._tensor(each) for each in (features, sources, targets))
        take = rows.index_select
        return self._in_batches(len(sources), lambda part: (take(0, first[part]), take(0, second[part])))

    def may_match(self, source: Features, targets: Features) -> NDArray[np.bool_]:
        """Return which targets (N, F) may have anything in common with a source (1, F), as a mask (N,)."""
        self._check(source, targets)
        keys = self.place_keys(targets)
        if keys is None or not len(targets):
            return np.ones(len(targets), bool)
        with torch.inference_mode():
            row = self._tensor(source)
            logits = self._network.place_scores(row, self._tensor(keys))
            likeness = self._network.likeness(row, targets, np.arange(len(targets)))
            return may_match(logits, likeness).cpu().numpy()

    @torch.inference_mode()
    def _encode(self, rgb: NDArray[np.uint8], depth_m: NDArray[np.floating]) -> NDArray[np.float16]:
        return pack_features(self._network.encode(*images_to_tensors(rgb, depth_m, self._device))).cpu().numpy()

    @torch.inference_mode()
    def _predict(self, sources: Features, targets: Features | Tensor) -> Prediction:
        def take(part: slice) -> tuple[Tensor, Tensor]:
            return self._tensor(sources if len(sources) == 1 else sources[part]), self._tensor(targets[part])

        return self._in_batches(len(targets), take)

    def _in_batches(self, count: int, take: Callable[[slice], tuple[Tensor, Tensor]]) -> Prediction:
        """Compare `count` pairs; `take` returns the sources and targets of a part of them."""
        reachability = [np.empty(0)]
        waypoints = [np.empty((0, 3))]
        for first in range(0, count, self._pairs_at_once):
            found, pose = self._compare(*take(slice(first, first + self._pairs_at_once)))
            reachability.append(found.cpu().double().numpy())
            waypoints.append(pose_to_waypoints(pose))
        return Prediction(np.concatenate(reachability), np.concatenate(waypoints))

    def _is_filtered(self, targets: int) -> bool:
        return targets > 1 and self._prefilter_from is not None and targets >= self._prefilter_from

    @torch.inference_mode()
    def _predict_filtered(self, source: Features, held: HeldFeatures) -> Prediction:
        row = self._tensor(source)
        keys = self._on_device(_KEYS, held, held.keys, held.rows)
        logits = self._network.place_scores(row, self._tensor(held.keys[held.rows] if keys is None else keys))
        near = np.arange(len(held.rows))
        keep = max(PLACE_KEEP, int(_PLACE_SHARE * len(near)))
        if len(near) > keep:
            near = np.sort(logits.topk(keep).indices.cpu().numpy())
        features, rows = self._features(held, held.rows[near])
        likeness = self._network.likeness(row, features, rows)
        # Sorted, so that equal inputs give equal batches and therefore bit-identical results.
        chosen = np.sort(likeness.topk(PREFILTER_KEEP).indices.cpu().numpy())
        full = self._predict(source, features[rows[chosen]])
        best = near[chosen]
        reachability = np.minimum(torch.sigmoid(logits).cpu().double().numpy(), full.reachability.min())
        waypoints = np.zeros((len(held.rows), 3))
        reachability[best], waypoints[best] = full
        return Prediction(reachability, waypoints)

    def _features(self, held: HeldFeatures, rows: NDArray[np.intp]) -> tuple[Features | Tensor, NDArray[np.intp]]:
        """Return features and the indices of the given rows (N,) in them; on a card, a copy there of just these."""
        kept = self._on_device(_FEATURES, held, held.features, rows)
        return (held.features, rows) if kept is None else (kept, np.arange(len(rows)))

    def _on_device(self, part: int, held: HeldFeatures, array: Features, rows: NDArray[np.intp]) -> Tensor | None:
        return None if self.kept is None or held.stamps is None else self.kept[part].take(array, held.stamps, rows)

    def _tensor(self, rows: NDArray[np.generic] | Tensor) -> Tensor:
        return to_tensor(rows, self._device)

    def _check(self, sources: Features, targets: Features) -> None:
        width = self._network.row_length
        if sources.ndim != 2 or targets.ndim != 2 or sources.shape[1] != width or targets.shape[1] != width:
            raise ValueError(f"Features must be (N, {width}), got {sources.shape} and {targets.shape}.")
        if len(sources) not in (1, len(targets)):
            raise ValueError(f"{len(sources)} sources cannot be paired with {len(targets)} targets one to one.")


def load_predictor(
    path: Path | str | None = None, *, prefilter_from: int | None = PREFILTER_FROM, device: str = "cpu"
) -> NetworkPredictor:
    """Open a trained network as a predictor.

    Args:
        path: The weights file, with its card beside it; None opens the shipped weights.
        prefilter_from: Number of targets from which on only the best by a cheap score are compared in full; None always
            compares all of them.
        device: The device that computes: `cpu`, `cuda`, `mps`, or `auto` for the fastest one.

    Raises:
        OptionError: The device is missing.
        WeightsError: The file is missing, damaged or not ours.
    """
    path = Path(path or SHIPPED_WEIGHTS)
    network = load_weights(path).to(choose_device(device))
    retain_freed_memory()
    limit_threads()
    return NetworkPredictor(network, weights_fingerprint(path), prefilter_from=prefilter_from, weights=path)


def images_to_tensors(
    rgb: NDArray[np.uint8], depth_m: NDArray[np.floating], device: torch.device = CPU
) -> tuple[Tensor, Tensor]:
    """Return rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres from arrays (B, H, W, 3) and (B, H, W)."""
    return to_tensor(rgb, device).permute(0, 3, 1, 2).float() / 255, to_tensor(depth_m, device).float()


def pose_to_waypoints(pose: Tensor) -> NDArray[np.float64]:
    """Return waypoints (P, 3) from network poses (P, 4): dx, dy, sin, cos."""
    x, y, sin, cos = pose.cpu().double().unbind(-1)
    return torch.stack([x, y, torch.atan2(sin, cos)], dim=-1).numpy()


def _checked(observation: Observation) -> Observation:
    expected = (NETWORK_CAMERA.height, NETWORK_CAMERA.width)
    depth = observation.require_depth("the network")
    if observation.rgb.shape != (*expected, 3) or depth.shape != expected:
        raise ImageError(
            f"Image {observation.step} is {observation.rgb.shape[:2]} with depth {depth.shape}; the network takes "
            f"{expected} (rows, columns). Preprocess it with ltvn_core.preprocessing.preprocess_observation, which "
            "rectifies images of any camera."
        )
    return observation
