"""Draws pairs of images of random walks, in groups for training, and labels them by time.

`ltvn_core.training_data.temporal_rules` has the labels, `ltvn_core.training_data.random_walk` the walks.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.training_data.pose_sampling import cluster_pairs
from ltvn_core.training_data.shards import Shard
from ltvn_core.training_data.temporal_rules import TemporalLabelRule
from ltvn_core.training_data.trajectory_pairs import UNKNOWN, UNREACHABLE

_BLOCK = 48
"""Consecutive images from which groups are drawn, a little more than the largest labelled distance."""
_GROUP = 12
"""Images of a group; each is encoded once and used in many pairs."""


def label_walks(shard: Shard, rule: TemporalLabelRule, rng: np.random.Generator, *, cross_pairs: int = 16) -> Shard:
    """Return a shard of walks with labelled pairs: all within each group, and `cross_pairs` per group to others.

    Images of different walks are labelled not reachable, because no robot drove from one to the other.
    """
    walk = shard.group
    time = np.arange(len(walk)) - np.searchsorted(walk, walk)
    order = np.lexsort((rng.random(len(walk)), time // _BLOCK, walk))
    group = np.empty(len(walk), np.int32)
    group[order] = np.arange(len(walk)) // _GROUP
    sources, targets = _pairs(order, group, rng, cross_pairs)
    labels = rule.labels_by_steps(time[targets] - time[sources], rng)
    labels = np.where(walk[sources] == walk[targets], labels, UNREACHABLE)
    known = labels != UNKNOWN
    count = int(known.sum())
    return replace(
        shard,
        group=group,
        sources=sources[known].astype(np.int32),
        targets=targets[known].astype(np.int32),
        reachable=labels[known] > UNREACHABLE,
        failed=np.zeros(count, np.uint8),
        overlap=np.full(count, np.nan, np.float32),
        path_ratio=np.full(count, np.nan, np.float32),
    )


def _pairs(
    order: NDArray[np.intp], group: NDArray[np.int32], rng: np.random.Generator, cross_pairs: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return sources and targets (P,): all ordered pairs within groups, and some across them."""
    groups = len(order) // _GROUP
    within = [order[ends] for ends in cluster_pairs(groups, _GROUP)]
    across = rng.integers(len(order), size=(cross_pairs * groups, 2))
    across = across[group[across[:, 0]] != group[across[:, 1]]]
    return np.concatenate([within[0], across[:, 0]]), np.concatenate([within[1], across[:, 1]])
