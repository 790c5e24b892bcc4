"""Draws near and far pairs of images: all of them where they are few, else evenly over sources and distances."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.training_data.truth_limits import LIMITS, TrueViews
from ltvn_core.types import Waypoint

_MOST_SOURCES = 2000
"""More images than this do not all look: the number of pairs to class grows with their square."""
_ROWS_AT_ONCE = 64


class PairCounts(NamedTuple):
    """How many pairs."""

    near: int
    far: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairSample:
    """P near and far pairs, those of one source beside each other."""

    sources: NDArray[np.intp]
    """(P,) rows of the images that look."""
    targets: NDArray[np.intp]
    """(P,) rows of the images that are looked for."""
    is_near: NDArray[np.bool_]
    """(P,): near; the others are far."""
    waypoints: Waypoint
    """(P, 3): the true ones."""
    near_pairs: int
    """Near pairs that there are,"""
    far_pairs: int
    """and far ones."""

    def thinned(self, most: PairCounts, rng: np.random.Generator) -> "PairSample":
        """Return at most so many pairs of it."""
        kinds = self.is_near, ~self.is_near
        chosen = [choose_evenly(np.flatnonzero(kind), count, rng) for kind, count in zip(kinds, most, strict=True)]
        kept = np.sort(np.concatenate(chosen))
        return PairSample(
            sources=self.sources[kept],
            targets=self.targets[kept],
            is_near=self.is_near[kept],
            waypoints=self.waypoints[kept],
            near_pairs=self.near_pairs,
            far_pairs=self.far_pairs,
        )


def sample_pairs(sources: TrueViews, targets: TrueViews, *, most: PairCounts, rng: np.random.Generator) -> PairSample:
    """Return at most `most` near and far pairs of S sources and T targets that were truly taken there.

    Pairs are taken at even steps from the list of all, ordered by source and then by distance, so that every source and
    every distance has its share. An image is never paired with itself, because it is not in front of itself.
    """
    looking = _evenly(len(sources), _MOST_SOURCES)
    counts = np.array([[part.sum() for part in kinds] for _, _, kinds in _rows(sources, targets, looking)]).reshape(
        -1, 2
    )
    picks = [choose_evenly(np.arange(total), count, rng) for total, count in zip(counts.sum(0), most, strict=True)]
    starts = np.cumsum(counts, axis=0) - counts
    parts: list[tuple[NDArray, ...]] = []
    for k, (source, waypoints, kinds) in enumerate(_rows(sources, targets, looking)):
        for kind, (mask, picked) in enumerate(zip(kinds, picks, strict=True)):
            first = starts[k, kind]
            inside = picked[np.searchsorted(picked, first) : np.searchsorted(picked, first + counts[k, kind])] - first
            rows = np.flatnonzero(mask)
            rows = rows[np.argsort(np.hypot(*waypoints[rows, :2].T), kind="stable")][inside]
            parts.append((np.full(len(rows), source), rows, np.full(len(rows), kind == 0), waypoints[rows]))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return PairSample(
        sources=columns[0].astype(np.intp),
        targets=columns[1].astype(np.intp),
        is_near=columns[2].astype(bool),
        waypoints=columns[3],
        near_pairs=int(counts[:, 0].sum()),
        far_pairs=int(counts[:, 1].sum()),
    )


def _rows(
    sources: TrueViews, targets: TrueViews, looking: NDArray[np.intp]
) -> Iterator[tuple[int, Waypoint, tuple[NDArray[np.bool_], NDArray[np.bool_]]]]:
    """Yield each source that looks, its waypoints to all targets (T, 3), and which are near and far (T,)."""
    for first in range(0, len(looking), _ROWS_AT_ONCE):
        chunk = looking[first : first + _ROWS_AT_ONCE]
        moves = sources.take(chunk).moves_to(targets)
        near, far = LIMITS.near(moves), LIMITS.far(moves)
        waypoints = relative(sources.poses[chunk][:, None], targets.poses[None])
        yield from ((int(row), waypoints[k], (near[k], far[k])) for k, row in enumerate(chunk))


def choose_evenly(rows: NDArray[np.intp], most: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return at most `most` of the rows, at even steps from a random start."""
    if len(rows) <= most:
        return rows
    return rows[((np.arange(most) + rng.random()) * len(rows) / most).astype(np.intp)]


def _evenly(count: int, most: int) -> NDArray[np.intp]:
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.intp)
