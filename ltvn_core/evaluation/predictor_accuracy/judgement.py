"""Evaluates a predictor on a recording with true poses: pairs, a map, and localisation.

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
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judgement:
    """Results of the evaluation of a predictor."""

    pairs: PairAccuracy | None
    """Accuracy of pairs; None without truth."""
    map: MapAccuracy
    localisation: LocalisationAccuracy | None
    """Accuracy of localisation in the map; None without truth."""
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
        """Evaluate the images."""
        sources = self.targets if self.looking is self.mapped else self._encoded("encode looks", self.looking)
        pairs = self._pair_accuracy(sources)
        built = self._built()
        return Judgement(
            pairs=pairs, map=self._map_accuracy(built), localisation=self._localisation(sources, built), built=built
        )

    def _pair_accuracy(self, sources: Features) -> PairAccuracy | None:
        looking = self.looking.views
        mapped = self.mapped.views
        if looking is None or mapped is None:
            return None
        most = PairCounts(near=max(self.plan.pairs // _FAR_PER_NEAR, 1), far=self.plan.pairs)
        sample = sample_pairs(looking, mapped, most=most, rng=self._rng(1))
        building = self.system.method.building
        with self.bars("compare", len(sample.sources), "pair") as progress:
            scores = score_pairs(self.predictor, sources, self.targets, sample, building, progress=progress)
        return pair_accuracy(scores, building, self._rng(2))

    def _encoded(self, step: str, sequence: JudgedSequence) -> Features:
        with self.bars(step, len(sequence.observations), "image") as progress:
            return encode_sequence(self.predictor, sequence.observations, progress)

    def _built(self) -> JudgedMap:
        rows = self.rows.mapped
        with self.bars("build", len(rows), "image") as progress:
            return build_judged_map(
                [self.mapped.observations[row] for row in rows],
                self.targets[rows],
                _taken(self.mapped.views, rows),
                predictor=self.predictor,
                system=self.system,
                rng=self._rng(5),
                progress=_further(progress),
            )

    def _map_accuracy(self, built: JudgedMap) -> MapAccuracy:
        with self.bars("recognise", len(built.observations), "image") as progress:
            return map_accuracy(built, progress=_further(progress))

    def _localisation(self, sources: Features, built: JudgedMap) -> LocalisationAccuracy | None:
        views = _taken(self.looking.views, self.rows.looks)
        if views is None or built.views is None:
            return None
        with self.bars("localise", len(self.rows.looks), "image") as progress:
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
    return diagnose(drive, coverage._replace(share=judgement.map.largest_piece_share))


def _pair_findings(judgement: Judgement) -> Iterator[Finding]:
    pairs = judgement.pairs
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
    looks = judgement.localisation
    if looks is not None and looks.looks_elsewhere:
        yield Finding(
            f"{looks.looks_elsewhere} of {looks.looks + looks.looks_elsewhere} images were taken where the map has no "
            "image nearby; they do not count.",
            Severity.INFO,
        )
