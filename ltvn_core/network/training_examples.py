"""Training examples, and the sampling of batches: each image is encoded once and used in several pairs.

Examples are given by a Protocol and come from shards or recordings. Half of a fine-tuning batch is from the robot's own
drive and half from simulation, to prevent forgetting (rehearsal).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.network.training_data.trajectory_pairs import TrajectoryPairs
from ltvn_core.types import Pose, Waypoint

DISTANCE_BINS_M = np.array([0.25, 0.5, 0.8, 1.1, 1.4, 1.8, 2.2])
"""Edges of the distance bins over which positives are balanced, in metres."""


class SceneExamples(Protocol):
    """Images of one scene with labelled pairs; `ltvn_core.network.training_data.shards.Shard` is one."""

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


class HardNegative(NamedTuple):
    """A far pair that the network predicted as reachable."""

    scene: int
    source: int
    target: int


@dataclass(frozen=True, slots=True)
class FarCriterion:
    """Limits beyond which a pair is certainly a negative (ours; well beyond the limits of reachability)."""

    distance_m: float = 3.0
    """Pairs with a larger distance are far."""
    yaw_rad: float = radians(92)
    """Pairs with a larger difference of heading are far."""

    def pairs(self, sources: Pose, targets: Pose) -> NDArray[np.bool_]:
        """Return (S, T): which of sources (S, 3) and targets (T, 3) are far from each other."""
        shift = sources[:, None, :2] - targets[None, :, :2]
        turn = np.abs(wrap_angle(sources[:, None, 2] - targets[None, :, 2]))
        return (np.hypot(shift[..., 0], shift[..., 1]) > self.distance_m) | (turn > self.yaw_rad)


class TrainingBatch(NamedTuple):
    """B images and P pairs of them."""

    images: Sequence[tuple[int, NDArray[np.intp]]]
    """Number of a scene in the sampler's `image_scenes`, and rows of its images; B rows in all."""
    poses: Pose
    """(B, 3) poses, each in its scene's frame."""
    scene: NDArray[np.intp]
    """(B,) number of each image's scene."""
    sources: NDArray[np.intp]
    """(P,) rows of the source images."""
    targets: NDArray[np.intp]
    """(P,) rows of the target images."""
    reachable: NDArray[np.bool_]
    """(P,) whether each pair is reachable."""
    apart: NDArray[np.bool_] | None = None
    """(B, B) whether two images are certainly not reachable from each other; None if poses and scenes decide it."""

    def waypoints(self, sources: NDArray[np.intp], targets: NDArray[np.intp]) -> Waypoint:
        """Return targets in the sources' frames (P, 3); meaningless between scenes."""
        return relative(self.poses[sources], self.poses[targets])

    def far_apart(self, far: FarCriterion) -> NDArray[np.bool_]:
        """Return (B, B): pairs that are certainly not reachable, also those of different scenes."""
        if self.apart is not None:
            return self.apart
        return (self.scene[:, None] != self.scene[None, :]) | far.pairs(self.poses, self.poses)


class BatchSampler:
    """Draws batches from the examples of all scenes."""

    def __init__(self, scenes: Sequence[SceneExamples], *, evened: bool = True) -> None:
        self.scenes = scenes
        self.image_scenes = scenes
        """Where the images of batches are from."""
        within = [scene.group[scene.sources] == scene.group[scene.targets] for scene in scenes]
        self._pairs = [_pairs_by_group(scene, mask) for scene, mask in zip(scenes, within, strict=True)]
        self._cross_cluster_pairs = [_pairs_by_group(scene, ~mask) for scene, mask in zip(scenes, within, strict=True)]
        self._images = [_rows_by_group(scene.group, scene) for scene in scenes]
        alike = [np.ones(len(scene.sources)) for scene in scenes]
        self._weights = _pair_weights(scenes, within) if evened else alike

    def draw(
        self, rng: np.random.Generator, *, groups: int, pairs_per_group: int, confusions: Sequence[HardNegative] = ()
    ) -> TrainingBatch:
        """Draw about `groups` clusters, and the given number of labelled pairs from each, balanced over distance.

        Clusters are drawn in twos, with a labelled pair from one to the other if there is one. The clusters of both
        images of each confusion are added, and the confusion becomes one of the pairs.
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
            drawn = _weighted_sample(rng, self._pairs[scene][group], self._weights[scene], pairs_per_group)
            pairs.extend(self._labelled(scene, int(k)) for k in drawn)
        pairs.extend(across)
        numbers, drawn = np.array(list(rows), np.intp).T
        images = [(int(scene), drawn[numbers == scene]) for scene in np.unique(numbers)]
        return TrainingBatch(
            images=images,
            poses=np.concatenate([self.scenes[scene].poses[part] for scene, part in images]),
            scene=numbers,
            sources=np.array([rows[scene, source] for scene, source, _, _ in pairs], np.intp),
            targets=np.array([rows[scene, target] for scene, _, target, _ in pairs], np.intp),
            reachable=np.array([reachable for *_, reachable in pairs], bool),
        )


def _weighted_sample(
    rng: np.random.Generator, pairs: NDArray[np.intp], weights: NDArray[np.float64], count: int
) -> NDArray[np.intp]:
    """Return up to `count` of some pairs, drawn without replacement by the weights of all pairs."""
    # The smallest of exponential keys with these rates are such a sample.
    return pairs[np.argsort(rng.exponential(size=len(pairs)) / weights[pairs])[:count]]


def _pairs_by_group(scene: SceneExamples, mask: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return, for each cluster, the masked pairs whose source is in it."""
    pairs = np.flatnonzero(mask)
    return [pairs[rows] for rows in _rows_by_group(scene.group[scene.sources[pairs]], scene)]


def _rows_by_group(group: NDArray[np.int32], scene: SceneExamples) -> list[NDArray[np.intp]]:
    """Return, for each cluster of a scene, its positions in `group` (N,)."""
    order = np.argsort(group, kind="stable")
    return np.split(order, np.searchsorted(group[order], np.arange(1, scene.group.max() + 1)))


def _pair_weights(scenes: Sequence[SceneExamples], within: Sequence[NDArray[np.bool_]]) -> list[NDArray[np.float64]]:
    """Return the weight of each pair: reachable pairs are uniform over distance, and together weigh as much as all
    others."""
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


WINDOW_IMAGES = 8
"""Number of images drawn from one section of the drive, the size of a simulated cluster."""


class MixedBatchSampler(BatchSampler):
    """Draws batches from a drive and from simulated scenes; the drive has the scene number after the last scene."""

    def __init__(
        self, drive: TrajectoryPairs, scenes: Sequence[SceneExamples], far: FarCriterion, *, evened: bool = True
    ) -> None:
        super().__init__(scenes, evened=evened)
        self.drive = drive
        self.image_scenes = [*scenes, drive]
        self.far = far
        self.reach = int(np.abs(drive.targets - drive.sources).max(initial=1))
        # The labelled pair (N, 2 reach + 1) from each image to those up to `reach` before or after it, or -1.
        self._pair_at = np.full((len(drive.poses), 2 * self.reach + 1), -1)
        self._pair_at[drive.sources, drive.targets - drive.sources + self.reach] = np.arange(len(drive.sources))
        self._weights_of_drive = _even_weights(drive) if evened else np.ones(len(drive.sources))
        self._held_out = drive.held_out
        self.learnable = np.flatnonzero(~self._held_out)

    @property
    def drive_number(self) -> int:
        """Return the drive's number among the scenes."""
        return len(self.scenes)

    def draw(
        self, rng: np.random.Generator, *, groups: int, pairs_per_group: int, confusions: Sequence[HardNegative] = ()
    ) -> TrainingBatch:
        """Draw half of the groups from the drive and half from simulation, and add hard negatives of both."""
        own = [each for each in confusions if each.scene == self.drive_number]
        foreign = [each for each in confusions if each.scene != self.drive_number]
        drawn = self._draw_drive(rng, groups // 2, pairs_per_group, own)
        if not self.scenes:
            return drawn
        simulated = super().draw(rng, groups=groups - groups // 2, pairs_per_group=pairs_per_group, confusions=foreign)
        return _joined(simulated, simulated.far_apart(self.far), drawn)

    def _draw_drive(
        self, rng: np.random.Generator, windows: int, pairs_per_window: int, confusions: Sequence[HardNegative]
    ) -> TrainingBatch:
        ends = [row for each in confusions for row in (each.source, each.target)]
        centres = np.concatenate([np.array(ends, np.intp), rng.choice(self.learnable, windows)])
        segments = [self._window(rng, int(centre)) for centre in centres]
        rows = np.unique(np.concatenate(segments))
        segment = np.concatenate([[0], np.cumsum(np.diff(rows) > self.reach)])
        pairs = np.unique(np.concatenate([self._choose_pairs(rng, each, pairs_per_window) for each in segments]))
        sources = np.concatenate([self.drive.sources[pairs], ends[0::2]]).astype(np.intp)
        targets = np.concatenate([self.drive.targets[pairs], ends[1::2]]).astype(np.intp)
        return TrainingBatch(
            images=[(self.drive_number, rows)],
            poses=self.drive.poses[rows],
            # Each section is a scene of its own, because only within one is odometry good enough to match surfaces.
            scene=self.drive_number + segment,
            sources=np.searchsorted(rows, sources),
            targets=np.searchsorted(rows, targets),
            reachable=np.concatenate([self.drive.reachable[pairs], np.zeros(len(confusions), bool)]),
            apart=self.drive.far(rows, rows),
        )

    def _window(self, rng: np.random.Generator, centre: int) -> NDArray[np.intp]:
        """Draw images from the section around a centre image, which is included."""
        rows = np.arange(max(centre - self.reach, 0), min(centre + self.reach + 1, len(self.drive.poses)))
        usable = ~self._held_out[rows] & (self.drive.piece[rows] == self.drive.piece[centre]) & (rows != centre)
        others = rng.permutation(rows[usable])[: WINDOW_IMAGES - 1]
        return np.sort(np.append(others, centre)).astype(np.intp)

    def _choose_pairs(self, rng: np.random.Generator, rows: NDArray[np.intp], count: int) -> NDArray[np.intp]:
        """Return labelled pairs among rows, drawn without replacement by weight."""
        apart = rows[None, :] - rows[:, None]
        near = np.abs(apart) <= self.reach
        pairs = self._pair_at[np.broadcast_to(rows[:, None], near.shape)[near], apart[near] + self.reach]
        return _weighted_sample(rng, pairs[pairs >= 0], self._weights_of_drive, count)


def _joined(simulated: TrainingBatch, simulated_apart: NDArray[np.bool_], own: TrainingBatch) -> TrainingBatch:
    """Return both batches as one; images of different scenes are certainly apart."""
    count = len(simulated.poses)
    apart = np.ones((count + len(own.poses),) * 2, bool)
    apart[:count, :count] = simulated_apart
    apart[count:, count:] = own.apart
    return TrainingBatch(
        images=[*simulated.images, *own.images],
        poses=np.concatenate([simulated.poses, own.poses]),
        scene=np.concatenate([simulated.scene, own.scene]),
        sources=np.concatenate([simulated.sources, own.sources + count]),
        targets=np.concatenate([simulated.targets, own.targets + count]),
        reachable=np.concatenate([simulated.reachable, own.reachable]),
        apart=apart,
    )


def _even_weights(drive: TrajectoryPairs) -> NDArray[np.float64]:
    """Return the weight of each labelled pair: positives are uniform over distance, and together weigh as much as
    negatives."""
    waypoints = relative(drive.poses[drive.sources], drive.poses[drive.targets])
    bins = np.digitize(np.hypot(waypoints[:, 0], waypoints[:, 1]), DISTANCE_BINS_M)
    kind = np.where(drive.reachable, bins, len(DISTANCE_BINS_M) + 1)
    count = np.bincount(kind, minlength=len(DISTANCE_BINS_M) + 2)
    wish = np.full(len(count), 0.5 / max((count[:-1] > 0).sum(), 1))
    wish[-1] = 0.5
    return np.minimum(wish / np.maximum(count, 1) * len(kind), 10)[kind]
