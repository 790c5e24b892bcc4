"""Training examples, and the sampling of batches: each image is encoded once and used in several pairs.

Examples come in through a Protocol, from shards or recordings.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.types import Pose, Waypoint

DISTANCE_BINS_M = np.array([0.25, 0.5, 0.8, 1.1, 1.4, 1.8, 2.2])
"""Borders of the bins of distance over which positives are balanced."""


class SceneExamples(Protocol):
    """Images of one scene with labelled pairs; `ltvn_core.training_data.shards.Shard` is one."""

    @property
    def name(self) -> str: ...
    @property
    def rgb(self) -> NDArray[np.uint8]: ...
    @property
    def depth_mm(self) -> NDArray[np.uint16]: ...
    @property
    def poses(self) -> Pose: ...
    @property
    def group(self) -> NDArray[np.int32]: ...
    @property
    def sources(self) -> NDArray[np.int32]: ...
    @property
    def targets(self) -> NDArray[np.int32]: ...
    @property
    def reachable(self) -> NDArray[np.bool_]: ...


class TrainingBatch(NamedTuple):
    """B images and P pairs of them."""

    rgb: NDArray[np.uint8]
    """(B, H, W, 3)"""
    depth_mm: NDArray[np.uint16]
    """(B, H, W)"""
    poses: Pose
    """(B, 3), each in its scene's frame."""
    scene: NDArray[np.intp]
    """(B,)"""
    sources: NDArray[np.intp]
    """(P,) rows of the images."""
    targets: NDArray[np.intp]
    """(P,)"""
    reachable: NDArray[np.bool_]
    """(P,)"""
    apart: NDArray[np.bool_] | None = None
    """(B, B): pairs that are certainly not reachable, where poses and scenes alone do not decide it."""

    def waypoints(self, sources: NDArray[np.intp], targets: NDArray[np.intp]) -> Waypoint:
        """Return targets in the sources' frames (P, 3); meaningless between scenes."""
        return relative(self.poses[sources], self.poses[targets])


class HardNegative(NamedTuple):
    """A far pair that the network predicted as reachable."""

    scene: int
    source: int
    target: int


class BatchSampler:
    """Draws batches from the examples of all scenes."""

    def __init__(self, scenes: Sequence[SceneExamples], *, evened: bool = True) -> None:
        self.scenes = scenes
        within = [scene.group[scene.sources] == scene.group[scene.targets] for scene in scenes]
        self._pairs = [_pairs_by_group(scene, mask) for scene, mask in zip(scenes, within, strict=True)]
        self._cross_cluster_pairs = [_pairs_by_group(scene, ~mask) for scene, mask in zip(scenes, within, strict=True)]
        self._images = [_rows_by_group(scene.group, scene) for scene in scenes]
        alike = [np.ones(len(scene.sources)) for scene in scenes]
        self._weights = _pair_weights(scenes, within) if evened else alike

    def draw(
        self,
        rng: np.random.Generator,
        *,
        groups: int,
        pairs_per_group: int,
        confusions: Sequence[HardNegative] = (),
    ) -> TrainingBatch:
        """Draw about `groups` clusters, and the given number of labelled pairs from each, balanced over distance.

        Every second cluster is joined to the one before by a labelled pair across the two. The clusters of each
        confusion (both ends) come on top, and the confusion is one of the pairs.
        """
        chosen = {(c.scene, int(self.scenes[c.scene].group[row])) for c in confusions for row in (c.source, c.target)}
        across = []
        scenes = rng.choice(len(self.scenes), min(4, len(self.scenes)), replace=False)
        for position in range(max(groups // 2, 1)):
            scene = int(scenes[position % len(scenes)])
            group = int(rng.integers(len(self._images[scene])))
            chosen.add((scene, group))
            if len(cross_cluster_pairs := self._cross_cluster_pairs[scene][group]):
                pair = self._labelled(scene, int(rng.choice(cross_cluster_pairs)))
                chosen.add((scene, int(self.scenes[scene].group[pair[2]])))
                across.append(pair)
            else:
                chosen.add((scene, int(rng.integers(len(self._images[scene])))))
        across.extend((c.scene, c.source, c.target, False) for c in confusions)
        return self._assemble(rng, sorted(chosen), pairs_per_group, across)

    def _labelled(self, scene: int, pair: int) -> tuple[int, int, int, bool]:
        examples = self.scenes[scene]
        return scene, int(examples.sources[pair]), int(examples.targets[pair]), bool(examples.reachable[pair])

    def _assemble(
        self,
        rng: np.random.Generator,
        chosen: list[tuple[int, int]],
        pairs_per_group: int,
        across: list[tuple[int, int, int, bool]],
    ) -> TrainingBatch:
        rows: dict[tuple[int, int], int] = {}
        pairs: list[tuple[int, int, int, bool]] = []
        for scene, group in chosen:
            for image in self._images[scene][group]:
                rows[scene, int(image)] = len(rows)
            pairs.extend(self._labelled(scene, int(k)) for k in self._choose(rng, scene, group, pairs_per_group))
        pairs.extend(across)
        keys = list(rows)
        return TrainingBatch(
            rgb=np.stack([self.scenes[scene].rgb[image] for scene, image in keys]),
            depth_mm=np.stack([self.scenes[scene].depth_mm[image] for scene, image in keys]),
            poses=np.stack([self.scenes[scene].poses[image] for scene, image in keys]),
            scene=np.array([scene for scene, _ in keys], np.intp),
            sources=np.array([rows[scene, source] for scene, source, _, _ in pairs], np.intp),
            targets=np.array([rows[scene, target] for scene, _, target, _ in pairs], np.intp),
            reachable=np.array([reachable for *_, reachable in pairs], bool),
        )

    def _choose(self, rng: np.random.Generator, scene: int, group: int, count: int) -> NDArray[np.intp]:
        """Return pairs of a group, drawn without replacement by weight."""
        pairs = self._pairs[scene][group]
        # The smallest of exponential keys with these rates are a weighted sample without replacement.
        keys = rng.exponential(size=len(pairs)) / self._weights[scene][pairs]
        return pairs[np.argsort(keys)[:count]]


def _pairs_by_group(scene: SceneExamples, mask: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return, for each cluster, the masked pairs whose source it holds."""
    pairs = np.flatnonzero(mask)
    return [pairs[rows] for rows in _rows_by_group(scene.group[scene.sources[pairs]], scene)]


def _rows_by_group(group: NDArray[np.int32], scene: SceneExamples) -> list[NDArray[np.intp]]:
    """Return, for each cluster of a scene, where it occurs in `group` (N,)."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.searchsorted(group[order], np.arange(1, scene.group.max() + 1)))


def _pair_weights(scenes: Sequence[SceneExamples], within: Sequence[NDArray[np.bool_]]) -> list[NDArray[np.float64]]:
    """Return the weight of each pair: reachable pairs uniform over distance, and together as much as all others."""
    bins = []
    for scene in scenes:
        waypoints = relative(scene.poses[scene.sources], scene.poses[scene.targets])
        distance = np.digitize(np.hypot(waypoints[:, 0], waypoints[:, 1]), DISTANCE_BINS_M)
        # Close unreachable pairs with a small turn are more informative than those that are obviously unreachable.
        easy = (np.abs(waypoints[:, 2]) > 1.2) | (waypoints[:, 0] < -0.3) | (distance == len(DISTANCE_BINS_M))
        bins.append(np.where(scene.reachable, distance, len(DISTANCE_BINS_M) + 1 + easy))
    inside = np.concatenate([each[mask] for each, mask in zip(bins, within, strict=True)])
    count = np.bincount(inside, minlength=len(DISTANCE_BINS_M) + 3).astype(float)
    positive = count[: len(DISTANCE_BINS_M) + 1]
    target_share = np.concatenate([np.full(len(positive), 0.5 / max((positive > 0).sum(), 1)), [0.35, 0.15]])
    # A rare distance is not repeated more than ten times as often as it occurs.
    weight = np.minimum(target_share / np.maximum(count, 1) * count.sum(), 10)
    return [weight[each] for each in bins]
