"""Place recognition without poses: images of a drive against a matrix of loop closures."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.errors import DatasetError, DriveError
from ltvn_core.network.metrics import auc
from ltvn_core.types import Features, Predictor

_LEAST_GAP = 15
"""Least number of images between a place and its revisit, because images taken shortly after each other always show the
same place."""
_TEXTS = (".txt", ".csv")
_MOST_BYTES = 100_000_000
"""Maximum size of a matrix file: 5,000 images, as text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RevisitAccuracy:
    """Figures of place recognition. Each image is compared with all images long before it."""

    queries: int
    """Number of images that show a place that was seen before."""
    recall_at_1: float
    """Share of these images with a correct best match."""
    recall_at_full_precision: float
    """Share of these images with a correct best match whose score exceeds that of every wrong match of the drive."""
    average_precision: float
    """Average precision of the best match, over all images, including those without a revisit."""
    auc: float
    """AUC over all pairs."""


def read_revisits(path: Path, images: int) -> NDArray[np.bool_]:
    """Read the pairs of images (N, N) that show one place: 0 and 1 as text, or a picture with pixels above 0.

    Raises DatasetError if the file cannot be read or has another size.
    """
    try:
        held = read_foreign(path, most_bytes=_MOST_BYTES, what="loop-closure matrix")
        if path.suffix.lower() in _TEXTS:
            rows = held.decode().replace(",", " ").splitlines()
            matrix = np.array([row.split() for row in rows if row.strip() and not row.startswith("#")], float)
        else:
            picture = cv2.imdecode(np.frombuffer(held, np.uint8), cv2.IMREAD_GRAYSCALE)
            matrix = np.zeros((0, 0)) if picture is None else np.asarray(picture)
    except (OSError, ValueError, DriveError, cv2.error) as error:
        raise DatasetError(f"{path} cannot be read as a loop-closure matrix ({error}).") from error
    if matrix.shape != (images, images):
        raise DatasetError(
            f"{path} must be a matrix of {images} x {images} numbers, one row and one column for each image of the "
            f"recording, got {' x '.join(map(str, matrix.shape))}. It is text (.txt, .csv) or an image (.bmp, .png)."
        )
    return (matrix != 0) | (matrix.T != 0)


def revisit_accuracy(
    predictor: Predictor,
    features: Features,
    same_place: NDArray[np.bool_],
    *,
    progress: Callable[[int], object],
) -> RevisitAccuracy:
    """Return how well a predictor recognises places of a drive with features (N, F); truth is (N, N).

    The score of a pair is the larger r of its two directions. `progress` is called with the number of new images.
    """
    count = len(features)
    score = np.full((count, count), -1.0)
    progress(min(_LEAST_GAP, count))
    for row in range(_LEAST_GAP, count):
        earlier = features[: row - _LEAST_GAP + 1]
        there = predictor.predict(features[row : row + 1], earlier).reachability
        back = predictor.predict(earlier, np.repeat(features[row : row + 1], len(earlier), axis=0)).reachability
        score[row, : len(earlier)] = np.maximum(there, back)
        progress(1)
    return summarise_revisits(score, same_place)


def summarise_revisits(score: NDArray[np.float64], same_place: NDArray[np.bool_]) -> RevisitAccuracy:
    """Return the figures of scores (N, N) of row against column, -1 for pairs that are not compared. Truth is (N, N).

    Raises DatasetError if no image shows a place that was seen long before.
    """
    asked = score >= 0
    is_query = (same_place & asked).any(axis=1)
    if not is_query.any():
        raise DatasetError(
            f"According to the matrix no image shows a place that was also seen at least {_LEAST_GAP} images earlier, "
            "so there is nothing to recognise."
        )
    rows = np.flatnonzero(asked.any(axis=1))
    best = score[rows].argmax(axis=1)
    sure = score[rows, best]
    right = same_place[rows, best]
    surest_wrong = sure[~right].max(initial=-1.0)
    queries = int(is_query.sum())
    return RevisitAccuracy(
        queries=queries,
        recall_at_1=float(right.sum() / queries),
        recall_at_full_precision=float((right & (sure > surest_wrong)).sum() / queries),
        average_precision=_average_precision(sure, right, queries),
        auc=auc(score[asked], same_place[asked]),
    )


def _average_precision(sure: NDArray[np.float64], right: NDArray[np.bool_], queries: int) -> float:
    """Return the mean precision over the correct matches, by descending score; queries without a correct match count as
    0."""
    order = np.argsort(-sure, kind="stable")
    hits = right[order]
    precision = np.cumsum(hits) / np.arange(1, len(hits) + 1)
    return float(precision[hits].sum() / queries)
