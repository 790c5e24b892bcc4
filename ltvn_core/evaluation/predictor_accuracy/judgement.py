"""Evaluates a predictor on a recording with true poses: pairs, a map, and localisation, as recorded and perturbed.

Owns the order of these steps, the choice of images for the map, and the findings about doubtful figures. Reads and
writes no file.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.perturbations import DROPPED_FRAMES, FrameLoss, open_perturbation, perturb_all
from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence, encode_sequence
from ltvn_core.evaluation.predictor_accuracy.map_accuracy import (
    JudgedMap,
    LocalisationAccuracy,
    MapAccuracy,
    build_judged_map,
    localisation_accuracy,
    map_accuracy,
)
from ltvn_core.evaluation.predictor_accuracy.pair_accuracy import (
    PairAccuracy,
    PairCounts,
    PairSample,
    PairScores,
    choose_evenly,
    pair_accuracy,
    sample_pairs,
    score_pairs,
)
from ltvn_core.findings import Finding, Severity
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.build_progress import ProgressCallback
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.maps.map_check import MappedDrive, diagnose
from ltvn_core.maps.map_coverage import map_coverage
from ltvn_core.predictors.request import predictor_card
from ltvn_core.training.drive_path import TrueViews
from ltvn_core.types import Features, Predictor

_FAR_PER_NEAR = 8
_PERTURBED_SHARE = 4
"""Divisor of the numbers of pairs that are compared under a perturbation."""
_FEW_PAIRS = 100
_SAME_D = 0.005
"""Value of d (Eq. 2) between the motions in odometry and in truth, below which the motions count as equal."""


class ProgressBars(Protocol):
    """Shows the progress of consecutive steps."""

    def __call__(self, step: str, total: int, unit: str) -> AbstractContextManager[Callable[[int], object]]:
        """Begin a step of `total` units; return a callback for the number of newly finished units."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgementPlan:
    """Settings of the evaluation of a predictor."""

    pairs: int = 20_000
    """Maximum number of far pairs. The maximum for near pairs, which take longer to predict, is an eighth of it."""
    left_out: float = 0.2
    """Share of images, evenly spaced, that are localised in the map and not used to build it."""
    perturbations: tuple[str, ...] = ()
    """Names of perturbations, which change source images and not target images."""
    seed: int = 0

    def counts(self, divisor: int) -> PairCounts:
        """Return the maximum numbers of pairs, divided by a whole number."""
        return PairCounts(near=max(self.pairs // (_FAR_PER_NEAR * divisor), 1), far=max(self.pairs // divisor, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Results as recorded, or under one perturbation."""

    name: str
    """Name of the perturbation; empty for the results as recorded."""
    pairs: PairAccuracy | None
    """Accuracy of pairs; None without truth."""
    map: MapAccuracy
    localisation: LocalisationAccuracy | None
    """Accuracy of localisation in the map; None without truth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """Results, and the predictions behind them."""

    conditions: tuple[Condition, ...]
    """Results as recorded, then under each perturbation."""
    scores: PairScores | None
    """Predictions as recorded; None without truth."""
    built: JudgedMap


class _Rows(NamedTuple):
    looks: NDArray[np.intp]
    """Rows of the images that are localised in the map."""
    mapped: NDArray[np.intp]
    """Rows of the images that the map is built from."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judge:
    """Evaluates one predictor on source images and target images."""

    looking: JudgedSequence
    mapped: JudgedSequence
    predictor: Predictor
    system: NavigationSystem
    plan: JudgementPlan
    bars: ProgressBars

    @cached_property
    def targets(self) -> Features:
        """Features of the target images."""
        return self._encoded("encode", self.mapped)

    @cached_property
    def rows(self) -> "_Rows":
        """Rows of the images that are localised in the map, and of those that the map is built from."""
        count = len(self.mapped.observations)
        if self.looking is not self.mapped:
            return _Rows(np.arange(len(self.looking.observations)), np.arange(count))
        left_out = choose_evenly(np.arange(count), max(int(self.plan.left_out * count), 1), self._rng(0))
        return _Rows(left_out, np.setdiff1d(np.arange(count), left_out))

    def run(self) -> Judgement:
        """Evaluate the images as recorded, then under each perturbation."""
        sources = self.targets if self.looking is self.mapped else self._encoded("encode looks", self.looking)
        sample = self._sample()
        scores = None if sample is None else self._scored("compare", sources, sample)
        built = self._built("build", self.rows.mapped)
        recorded = Condition(
            name="",
            pairs=None if scores is None else pair_accuracy(scores, self.system.method.building, self._rng(2)),
            map=self._map_accuracy("recognise", built),
            localisation=self._localisation("localise", sources, built),
        )
        if sample is not None:
            sample = sample.thinned(self.plan.counts(_PERTURBED_SHARE), self._rng(3))
        worse = [self._perturbed(name, recorded, sources, sample, built) for name in self.plan.perturbations]
        return Judgement(conditions=(recorded, *worse), scores=scores, built=built)

    def _perturbed(
        self, name: str, recorded: Condition, sources: Features, sample: PairSample | None, built: JudgedMap
    ) -> Condition:
        if name == DROPPED_FRAMES:
            return self._with_lost_frames(recorded, sources)
        perturbation = open_perturbation(name, self.predictor.camera)
        worse = perturb_all(self.looking.observations, perturbation, seed=self.plan.seed)
        with self.bars(f"{name}: encode", len(worse), "image") as progress:
            sources = encode_sequence(self.predictor, worse, progress)
        scores = None if sample is None else self._scored(f"{name}: compare", sources, sample)
        return Condition(
            name=name,
            pairs=None if scores is None else pair_accuracy(scores, self.system.method.building, self._rng(2)),
            map=recorded.map,
            localisation=self._localisation(f"{name}: localise", sources, built),
        )

    def _with_lost_frames(self, recorded: Condition, sources: Features) -> Condition:
        """Evaluate a map built from the images that arrived; the accuracy of pairs is copied.

        A lost frame does not change other images, so the accuracy of their pairs is the same.
        """
        lost = FrameLoss().lost(len(self.mapped.observations), self._rng(4))
        arrived = self.rows.mapped[~lost[self.rows.mapped]]
        built = self._built(f"{DROPPED_FRAMES}: build", arrived)
        return Condition(
            name=DROPPED_FRAMES,
            pairs=recorded.pairs,
            map=self._map_accuracy(f"{DROPPED_FRAMES}: recognise", built),
            localisation=self._localisation(f"{DROPPED_FRAMES}: localise", sources, built),
        )

    def _sample(self) -> PairSample | None:
        looking = self.looking.views
        mapped = self.mapped.views
        if looking is None or mapped is None:
            return None
        return sample_pairs(looking, mapped, most=self.plan.counts(1), rng=self._rng(1))

    def _encoded(self, step: str, sequence: JudgedSequence) -> Features:
        with self.bars(step, len(sequence.observations), "image") as progress:
            return encode_sequence(self.predictor, sequence.observations, progress)

    def _scored(self, step: str, sources: Features, sample: PairSample) -> PairScores:
        with self.bars(step, len(sample.sources), "pair") as progress:
            return score_pairs(
                self.predictor, sources, self.targets, sample, self.system.method.building, progress=progress
            )

    def _built(self, step: str, rows: NDArray[np.intp]) -> JudgedMap:
        with self.bars(step, len(rows), "image") as progress:
            return build_judged_map(
                [self.mapped.observations[row] for row in rows],
                self.targets[rows],
                _taken(self.mapped.views, rows),
                predictor=self.predictor,
                system=self.system,
                rng=self._rng(5),
                progress=_further(progress),
            )

    def _map_accuracy(self, step: str, built: JudgedMap) -> MapAccuracy:
        with self.bars(step, len(built.observations), "image") as progress:
            return map_accuracy(built, progress=_further(progress))

    def _localisation(self, step: str, sources: Features, built: JudgedMap) -> LocalisationAccuracy | None:
        views = _taken(self.looking.views, self.rows.looks)
        if views is None or built.views is None:
            return None
        with self.bars(step, len(self.rows.looks), "image") as progress:
            return localisation_accuracy(built, sources[self.rows.looks], views, progress=progress)

    def _rng(self, purpose: int) -> np.random.Generator:
        """Return a random generator for one purpose, so that the draws for one purpose do not change those for
        another."""
        return np.random.default_rng([self.plan.seed, purpose])


def judge(
    looking: JudgedSequence,
    mapped: JudgedSequence,
    *,
    predictor: Predictor,
    system: NavigationSystem,
    plan: JudgementPlan,
    bars: ProgressBars,
) -> Judgement:
    """Evaluate a predictor on source images against target images.

    If both sequences are the same, one part of its images builds the map and the other part is localised in it.
    Otherwise, all images of `mapped` build the map, and all images of `looking` are localised in it.

    Raises:
        MapError: No map can be built from the images.
    """
    return _Judge(looking=looking, mapped=mapped, predictor=predictor, system=system, plan=plan, bars=bars).run()


def _taken(views: TrueViews | None, rows: NDArray[np.intp]) -> TrueViews | None:
    return None if views is None else views.take(rows)


def _further(progress: Callable[[int], object]) -> ProgressCallback:
    """Return a callback with the numbers of finished and of all images; it calls `progress` with the newly finished."""
    last = 0

    def show(done: int, total: int) -> None:
        nonlocal last
        progress(max(done - last, 0))
        last = max(done, last)

    return show


def judgement_findings(
    judgement: Judgement, sequences: Sequence[JudgedSequence], *, predictor_name: str = ""
) -> tuple[Finding, ...]:
    """Return findings that a reader of these figures must know, with likely causes of an unusable map.

    Args:
        judgement: The figures.
        sequences: The evaluated images, those of the map last.
        predictor_name: Name of the predictor.
    """
    return (
        *_pair_findings(judgement),
        *(finding for sequence in sequences for finding in _odometry_findings(sequence)),
        *_look_findings(judgement),
        *_map_findings(judgement, sequences[-1], predictor_name),
    )


def _map_findings(judgement: Judgement, mapped: JudgedSequence, predictor_name: str) -> tuple[Finding, ...]:
    built = judgement.built.map
    observations = judgement.built.observations
    coverage = map_coverage(observations, built.graph, built.keyframes, built.predictor, built.system)
    drive = MappedDrive(
        observations=observations,
        camera=mapped.camera,
        is_lens_known=mapped.is_lens_known,
        graph=built.graph,
        keyframes=built.keyframes,
        predictor=built.predictor,
        predictor_name=predictor_name,
        least_width_px=predictor_card(built.predictor).least_width_px,
    )
    # The share is taken from the figures, so that the findings agree with them.
    return diagnose(drive, coverage._replace(share=judgement.conditions[0].map.largest_piece_share))


def _pair_findings(judgement: Judgement) -> Iterator[Finding]:
    pairs = judgement.conditions[0].pairs
    if pairs is None:
        return
    for kind, count in (("near", pairs.near_pairs), ("far", pairs.far_pairs)):
        if not count:
            yield Finding(f"There are no {kind} pairs, so the share that the predictor accepts is unknown.")
        elif count < _FEW_PAIRS:
            yield Finding(f"There are only {count} {kind} pairs, so the share of them that is accepted is uncertain.")
    if not pairs.near_pairs:
        yield Finding("Are the true poses in metres and, for two recordings, in one frame?")


def _odometry_findings(sequence: JudgedSequence) -> Iterator[Finding]:
    if sequence.views is None:
        return
    name = sequence.path.name
    odometry = np.array([seen.odometry for seen in sequence.observations])
    if not odometry.any():
        yield Finding(f"{name} has no odometry, so its map is built from images alone.", where=name)
        return
    driven = relative(odometry[:-1], odometry[1:])
    poses = sequence.views.poses
    moved = relative(poses[:-1], poses[1:])
    if (distance(relative(driven, moved)) < _SAME_D).all():
        text = (
            f"The odometry of {name} is its true poses, so its map has fewer false edges than a map from a robot's "
            "odometry would."
        )
        yield Finding(text, where=name)


def _look_findings(judgement: Judgement) -> Iterator[Finding]:
    looks = judgement.conditions[0].localisation
    if looks is not None and looks.looks_elsewhere:
        yield Finding(
            f"{looks.looks_elsewhere} of {looks.looks + looks.looks_elsewhere} images were taken where the map has no "
            "image nearby; they do not count.",
            Severity.INFO,
        )
