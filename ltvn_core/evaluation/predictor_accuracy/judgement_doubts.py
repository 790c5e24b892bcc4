"""What is doubtful of the figures of a judgement, in words. Decides nothing."""

from collections.abc import Iterator, Sequence

import numpy as np

from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence
from ltvn_core.evaluation.predictor_accuracy.judgement import Judgement
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.map_coverage import map_coverage
from ltvn_core.graph.map_diagnosis import MappedDrive, diagnose
from ltvn_core.predictors.request import predictor_card

_FEW_PAIRS = 100
_SAME_D = 0.005
"""Odometry that agrees so well with the truth, image by image, was not measured."""


def judgement_doubts(
    judgement: Judgement, sequences: Sequence[JudgedSequence], *, predictor_name: str = ""
) -> tuple[str, ...]:
    """Return what a reader of these figures must know, with likely causes of a map that nobody can navigate by.

    Args:
        judgement: The figures.
        sequences: The images that were judged, those of the map last.
        predictor_name: By what name the predictor was asked for.
    """
    return (
        *_pair_doubts(judgement),
        *(doubt for sequence in sequences for doubt in _odometry_doubts(sequence)),
        *_look_doubts(judgement),
        *_map_doubts(judgement, sequences[-1], predictor_name),
    )


def _map_doubts(judgement: Judgement, mapped: JudgedSequence, predictor_name: str) -> tuple[str, ...]:
    built = judgement.built
    coverage = map_coverage(built.observations, built.graph, built.keyframes, built.predictor, built.system)
    drive = MappedDrive(
        observations=built.observations,
        camera=mapped.camera,
        is_lens_known=mapped.is_lens_known,
        graph=built.graph,
        keyframes=built.keyframes,
        predictor=built.predictor,
        predictor_name=predictor_name,
        least_width_px=predictor_card(built.predictor).least_width_px,
    )
    # The share is that of the figures, so that a reader does not find two of them.
    return diagnose(drive, coverage._replace(share=judgement.conditions[0].map.largest_piece_share))


def _pair_doubts(judgement: Judgement) -> Iterator[str]:
    pairs = judgement.conditions[0].pairs
    if pairs is None:
        return
    for kind, count in (("near", pairs.near_pairs), ("far", pairs.far_pairs)):
        if not count:
            yield f"There are no {kind} pairs, so nobody can say how many the predictor accepts."
        elif count < _FEW_PAIRS:
            yield f"There are only {count} {kind} pairs, so the share of them that is accepted is uncertain."
    if not pairs.near_pairs:
        yield "Are the true poses in metres, and, of two recordings, in one frame?"


def _odometry_doubts(sequence: JudgedSequence) -> Iterator[str]:
    if sequence.views is None:
        return
    odometry = np.array([seen.odometry for seen in sequence.observations])
    if not odometry.any():
        yield f"{sequence.path.name} has no odometry, so its map is built from images alone."
        return
    driven = relative(odometry[:-1], odometry[1:])
    poses = sequence.views.poses
    moved = relative(poses[:-1], poses[1:])
    if (distance(relative(driven, moved)) < _SAME_D).all():
        yield (
            f"The odometry of {sequence.path.name} is its true poses, so its map has fewer false edges than one of a "
            "robot would."
        )


def _look_doubts(judgement: Judgement) -> Iterator[str]:
    looks = judgement.conditions[0].localisation
    if looks is not None and looks.looks_elsewhere:
        yield (
            f"{looks.looks_elsewhere} of {looks.looks + looks.looks_elsewhere} images that were looked for were taken "
            "where the map has no image near; they do not count."
        )
