"""Evaluates a predictor on a recording with true poses: pairs, a map, and localisation.

Owns the order of these steps, the choice of images for the map, and the findings about doubtful figures. Reads and
writes no file.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

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

    def rng(purpose: int) -> np.random.Generator:
        # One generator for each purpose, so that the draws for one do not change those for another.
        return np.random.default_rng([plan.seed, purpose])

    def encoded(step: str, sequence: JudgedSequence) -> Features:
        with bars(step, len(sequence.observations), "image") as progress:
            return encode_sequence(predictor, sequence.observations, progress)

    targets = encoded("encode", mapped)
    sources = targets if looking is mapped else encoded("encode looks", looking)
    looks, built_from = np.arange(len(looking.observations)), np.arange(len(mapped.observations))
    if looking is mapped:
        looks = choose_evenly(built_from, max(int(plan.left_out * len(built_from)), 1), rng(0))
        built_from = np.setdiff1d(built_from, looks)

    pairs = localisation = None
    if looking.views is not None and mapped.views is not None:
        most = PairCounts(near=max(plan.pairs // _FAR_PER_NEAR, 1), far=plan.pairs)
        sample = sample_pairs(looking.views, mapped.views, most=most, rng=rng(1))
        building = system.method.building
        with bars("compare", len(sample.sources), "pair") as progress:
            scores = score_pairs(predictor, sources, targets, sample, building, progress=progress)
        pairs = pair_accuracy(scores, building, rng(2))
    with bars("build", len(built_from), "image") as progress:
        built = build_judged_map(
            [mapped.observations[row] for row in built_from],
            targets[built_from],
            None if mapped.views is None else mapped.views.take(built_from),
            predictor=predictor,
            system=system,
            rng=rng(5),
            progress=_further(progress),
        )
    with bars("recognise", len(built.observations), "image") as progress:
        found = map_accuracy(built, progress=_further(progress))
    if looking.views is not None and built.views is not None:
        with bars("localise", len(looks), "image") as progress:
            localisation = localisation_accuracy(built, sources[looks], looking.views.take(looks), progress=progress)
    return Judgement(pairs=pairs, map=found, localisation=localisation, built=built)


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
