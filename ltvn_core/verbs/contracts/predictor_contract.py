"""The check of a plug-in's contract, and the contract of predictors.

A predictor must return arrays of the right shape, valid numbers, and the same result for the same images. Also owns the
sample images with depth for contract tests, which come from the demo map of the toolkit.
"""

import pickle
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.data.recording.demo_files import DEMO_MAP, demo_file
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError, RecordingError
from ltvn_core.plugins import Plugin
from ltvn_core.predictors.opening import open_plugin
from ltvn_core.predictors.request import PredictorRequest, predictor_card
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.types import Features, Observation, Prediction, Predictor

Check: TypeAlias = Callable[[], str]
"""Function that checks one requirement: returns what it measured, and raises any exception if the contract is
broken."""


@dataclass(frozen=True, slots=True)
class ContractCheck:
    """Result of one check."""

    check: str
    """Requirement that is checked."""
    passed: bool
    said: str
    """Measured value, or the problem."""

    def __str__(self) -> str:
        return f"{'ok     ' if self.passed else 'BROKEN '} {self.check}" + (f": {self.said}" if self.said else "")


class BrokenContractError(Exception):
    """A plug-in breaks its contract; the message says what it did instead."""


def require(kept: bool, otherwise: str) -> None:
    """Raise BrokenContractError with the message `otherwise` unless `kept` is true."""
    if not kept:
        raise BrokenContractError(otherwise)


def run_check(name: str, check: Check) -> ContractCheck:
    """Run one check; any exception counts as a broken contract."""
    try:
        return ContractCheck(name, passed=True, said=check())
    except (BrokenContractError, LtvnError) as broken:
        return ContractCheck(name, passed=False, said=str(broken))
    except Exception as error:  # Another person's code may raise anything.
        return ContractCheck(name, passed=False, said=f"{type(error).__name__}: {error}")


def run_checks(first: tuple[str, Check], others: Iterable[tuple[str, Check]]) -> Iterator[ContractCheck]:
    """Run all checks; if the first one fails, the others cannot run."""
    begun = run_check(*first)
    yield begun
    if begun.passed:
        yield from (run_check(name, check) for name, check in others)


IMAGES = 8
TOLERANCE = 0.01
"""Tolerance of equal results: batches of another size may add numbers in another order, and features may be half
floats."""
SAME_PLACE_R = 0.5
SAME_PLACE_M = 0.25
"""Greatest distance, in metres, that a predictor may return for an image compared with itself."""
WALL_M = 1.0
"""Depth of the blank image, a plain wall, in metres."""


class SampleImages(NamedTuple):
    """The sample images and the metadata of their recording."""

    observations: tuple[Observation, ...]
    """The images in the order in which they were taken."""
    meta: RecordingMetadata


def sample_images(count: int) -> SampleImages:
    """Return the first images of the demo map. Raises RecordingError where the file is missing."""
    path = demo_file(DEMO_MAP)
    if path is None:
        raise RecordingError(f"{DEMO_MAP} is missing; reinstall the toolkit: pip install ltvn (or -e .)")
    recording = Recording.open(path)
    return SampleImages(tuple(recording.observation(frame) for frame in recording.frames[:count]), recording.meta)


def predictor_checks(plugin: Plugin, weights: Path | None = None) -> Iterator[ContractCheck]:
    """Open a predictor for the demo map's images, with weights or a card, and check its whole contract."""
    contract = PredictorContract(plugin, sample_images(IMAGES), weights)
    return run_checks(
        ("opens and has a card", contract.opens),
        [
            ("encodes one row for each image", contract.encodes_rows),
            ("encodes an image the same way in any order", contract.encodes_in_any_order),
            ("returns r in [0, 1] and finite waypoints", contract.returns_numbers),
            ("gives the same answer twice", contract.is_deterministic),
            ("gives the same answer for one target and for many", contract.broadcasts),
            ("accepts zero images and zero targets", contract.takes_nothing),
            ("recognises the same image", contract.knows_an_image_again),
            ("accepts a blank image", contract.accepts_a_blank_image),
            ("accepts an image without depth, or declares that it needs depth", contract.accepts_no_depth),
            ("can be opened by other processes", contract.opens_in_workers),
            ("is timed", contract.speed),
        ],
    )


@dataclass(frozen=True)
class PredictorContract:
    """The contract of a predictor, with the sample images for the test."""

    plugin: Plugin
    samples: SampleImages
    weights: Path | None = None

    @cached_property
    def request(self) -> PredictorRequest:
        """The request that it is opened with."""
        return PredictorRequest(self.samples.meta.scene, self.weights, self.samples.meta.camera)

    @cached_property
    def predictor(self) -> Predictor:
        """The predictor itself."""
        return open_plugin(self.plugin, self.request)

    @cached_property
    def images(self) -> list[Observation]:
        """The sample images, as taken by the predictor's camera."""
        camera = self.samples.meta.camera
        return [recorded_observation(seen, camera, self.predictor.camera) for seen in self.samples.observations]

    @cached_property
    def features(self) -> Features:
        """The features of all sample images."""
        return self.predictor.encode(self.images)

    def opens(self) -> str:
        """Check the card of the predictor."""
        card = predictor_card(self.predictor)
        again = predictor_card(open_plugin(self.plugin, self.request))
        require(card.fingerprint == again.fingerprint, "its fingerprint changes each time it is opened")
        if (known := card.likelihoods) is not None:
            require(
                0 < known.p_success_if_not < known.p_success_if_reachable < 1 and known.sigma2 > 0,
                f"its likelihoods must be 0 < p(s | not r) < p(s | r) < 1 and sigma2 > 0, got {known}",
            )
        needs = "needs depth" if card.needs_depth else "needs no depth"
        measured = "general constants" if known is None else "measured constants"
        return f"{card.fingerprint}, {card.camera.width} x {card.camera.height}, {needs}, {measured}"

    def encodes_rows(self) -> str:
        """Check the shape of the features."""
        rows = self.features
        require(isinstance(rows, np.ndarray), f"encode must return a numpy array, got {type(rows).__name__}")
        require(
            rows.ndim == 2 and len(rows) == IMAGES,
            f"encode must return (N, F), one row for each image, got {rows.shape} for {IMAGES}",
        )
        return f"{rows.shape[1]} x {rows.dtype}"

    def encodes_in_any_order(self) -> str:
        """Check that images in reverse order, and one by one, give the same results."""
        backwards = self.predictor.encode(self.images[::-1])[::-1]
        self._require_equal(self._compare(backwards), self._compare(self.features), "in reverse order")
        alone = np.concatenate([self.predictor.encode([seen]) for seen in self.images])
        self._require_equal(self._compare(alone), self._compare(self.features), "one by one")
        return ""

    def returns_numbers(self) -> str:
        """Check r and waypoints of all pairs."""
        found = self._compare(self.features)
        self._require_sound(found, IMAGES * IMAGES)
        return f"r from {found.reachability.min():.2f} to {found.reachability.max():.2f}"

    def is_deterministic(self) -> str:
        """Check that two comparisons give the same result."""
        first = self._compare(self.features)
        second = self._compare(self.features)
        same = np.array_equal(first.reachability, second.reachability) and np.array_equal(
            first.waypoints, second.waypoints
        )
        require(same, "the second answer differs from the first")
        return ""

    def broadcasts(self) -> str:
        """Check that one source gives the same results with all targets at once and with each alone."""
        together = self.predictor.predict(self.features[:1], self.features)
        pairs = [self.predictor.predict(self.features[:1], self.features[k : k + 1]) for k in range(IMAGES)]
        apart = Prediction(
            np.concatenate([each.reachability for each in pairs]), np.concatenate([each.waypoints for each in pairs])
        )
        self._require_sound(together, IMAGES)
        self._require_equal(together, apart, "all at once")
        return ""

    def takes_nothing(self) -> str:
        """Check that zero images and zero targets are accepted."""
        require(len(self.predictor.encode([])) == 0, "encode must return zero rows for zero images")
        self._require_sound(self.predictor.predict(self.features[:1], self.features[:0]), 0)
        return ""

    def knows_an_image_again(self) -> str:
        """Check that each image is recognised when compared with itself."""
        found = self.predictor.predict(self.features, self.features)
        away = np.hypot(found.waypoints[:, 0], found.waypoints[:, 1])
        least = float(found.reachability.min())
        farthest = float(away.max())
        require(
            least >= SAME_PLACE_R and farthest <= SAME_PLACE_M,
            f"an image compared with itself should have r of at least {SAME_PLACE_R} and lie within {SAME_PLACE_M} m, "
            f"got r {least:.2f} and {farthest:.2f} m",
        )
        return f"r at least {least:.2f}, within {100 * farthest:.1f} cm"

    def accepts_a_blank_image(self) -> str:
        """Check a black image of a plain wall against itself and the other images."""
        seen = self.images[0]
        depth = np.full(seen.rgb.shape[:2], WALL_M, np.float32)
        return self._accepts(replace(seen, rgb=np.zeros_like(seen.rgb), depth=depth))

    def accepts_no_depth(self) -> str:
        """Check an image without depth against itself and the other images."""
        if predictor_card(self.predictor).needs_depth:
            return "not needed: it gets only images with depth"
        self._accepts(replace(self.images[0], depth=np.zeros(self.images[0].rgb.shape[:2], np.float32)))
        return self._accepts(replace(self.images[0], depth=None))

    def opens_in_workers(self) -> str:
        """Check that the factory and the features can be sent to another process and back."""
        factory = self.plugin.load()
        require(pickle.loads(pickle.dumps(factory)) is factory, "its factory must be a function or class of a module")
        sent = pickle.loads(pickle.dumps(self.features))
        self._require_equal(self._compare(sent), self._compare(self.features), "after a copy to another process")
        return ""

    def speed(self) -> str:
        """Return the time per image and per pair; the author must judge whether it is short enough."""
        before = time.perf_counter()
        self.predictor.encode(self.images)
        encoded = time.perf_counter()
        self.predictor.predict(self.features[:1], self.features)
        compared = time.perf_counter()
        image_ms, pair_ms = (1e3 * seconds / IMAGES for seconds in (encoded - before, compared - encoded))
        return f"{image_ms:.1f} ms per image, {pair_ms:.2f} ms per pair"

    def _accepts(self, seen: Observation) -> str:
        row = self.predictor.encode([seen])
        self._require_sound(self.predictor.predict(row, self.features), IMAGES)
        self._require_sound(self.predictor.predict(row, row), 1)
        found = float(self.predictor.predict(row, self.features).reachability.max())
        return f"r at most {found:.2f} with other images"

    def _compare(self, rows: Features) -> Prediction:
        """Compare all images with all images."""
        count = len(rows)
        return self.predictor.predict(rows[np.repeat(np.arange(count), count)], rows[np.tile(np.arange(count), count)])

    @staticmethod
    def _require_sound(found: Prediction, count: int) -> None:
        r = np.asarray(found.reachability)
        waypoints = np.asarray(found.waypoints)
        require(
            r.shape == (count,) and waypoints.shape == (count, 3),
            f"predict must return r ({count},) and waypoints ({count}, 3), got {r.shape} and {waypoints.shape}",
        )
        require(_all_finite(r) and _all_finite(waypoints), "r and waypoints must be finite, got NaN or infinity")
        require(bool(np.all((r >= 0) & (r <= 1))), "r must lie in [0, 1]")

    @staticmethod
    def _require_equal(found: Prediction, expected: Prediction, how: str) -> None:
        apart = max(
            float(np.abs(found.reachability - expected.reachability).max(initial=0)),
            float(np.abs(found.waypoints - expected.waypoints).max(initial=0)),
        )
        require(apart <= TOLERANCE, f"the answers {how} differ by {apart:.3g}")


def _all_finite(values: NDArray[np.generic]) -> bool:
    return bool(np.all(np.isfinite(values)))
