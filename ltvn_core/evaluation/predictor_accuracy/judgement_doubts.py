"""What is doubtful of the figures of a judgement, in words. Decides nothing."""

from collections.abc import Iterator, Sequence

import numpy as np

from ltvn_core.evaluation.predictor_accuracy.judged_sequence import JudgedSequence
from ltvn_core.evaluation.predictor_accuracy.judgement import Judgement
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.map_check import map_doubts

_FEW_PAIRS = 100
_SAME_D = 0.005
"""Odometry that agrees so well with the truth, image by image, was not measured."""


def judgement_doubts(judgement: Judgement, sequences: Sequence[JudgedSequence]) -> tuple[str, ...]:
    """Return what a reader of these figures must know."""
    return (
        *_pair_doubts(judgement),
        *(doubt for sequence in sequences for doubt in _odometry_doubts(sequence)),
        *_look_doubts(judgement),
        *map_doubts(judgement.built.graph, len(judgement.built.observations)),
    )


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
