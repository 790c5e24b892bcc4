"""Batches for fine-tuning: half from the robot's own drive, half from simulation against forgetting (rehearsal).

`ltvn_core.network.training_examples` draws the simulated half.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.network.optimization.hard_negative_mining import FarCriterion
from ltvn_core.network.training_examples import (
    DISTANCE_BINS_M,
    BatchSampler,
    HardNegative,
    SceneExamples,
    TrainingBatch,
)

WINDOW_IMAGES = 8
"""Images drawn from one section of the drive, as many as a simulated cluster has."""


class LabelledTrajectory(SceneExamples, Protocol):
    """Images of one drive in their order, labelled by odometry; see `ltvn_core.training_data.trajectory_pairs`."""

    @property
    def piece(self) -> NDArray[np.int32]: ...
    @property
    def held_out(self) -> NDArray[np.bool_]: ...
    def far(self, sources: NDArray[np.integer], targets: NDArray[np.integer]) -> NDArray[np.bool_]: ...


class MixedBatchSampler(BatchSampler):
    """A drive and simulated scenes; the drive counts as the scene after the last one."""

    def __init__(
        self, drive: LabelledTrajectory, scenes: Sequence[SceneExamples], far: FarCriterion, *, evened: bool = True
    ) -> None:
        super().__init__(scenes, evened=evened)
        self.drive = drive
        self.far = far
        self.reach = int(np.abs(drive.targets - drive.sources).max(initial=1))
        self._pair_at = _pair_table(drive, self.reach)
        self._weights_of_drive = _even_weights(drive) if evened else np.ones(len(drive.sources))
        self._held_out = drive.held_out
        self.learnable = np.flatnonzero(~self._held_out)

    @property
    def drive_number(self) -> int:
        """Return the drive's number among the scenes."""
        return len(self.scenes)

    def draw(
        self,
        rng: np.random.Generator,
        *,
        groups: int,
        pairs_per_group: int,
        confusions: Sequence[HardNegative] = (),
    ) -> TrainingBatch:
        """Draw half of the groups from the drive and half from simulation, and add hard negatives of both."""
        own = [each for each in confusions if each.scene == self.drive_number]
        foreign = [each for each in confusions if each.scene != self.drive_number]
        drawn = self._draw_drive(rng, groups // 2, pairs_per_group, own)
        if not self.scenes:
            return drawn
        simulated = super().draw(rng, groups=groups - groups // 2, pairs_per_group=pairs_per_group, confusions=foreign)
        return _joined(simulated, self._simulated_apart(simulated), drawn)

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
            rgb=self.drive.rgb[rows],
            depth_mm=self.drive.depth_mm[rows],
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
        pairs = pairs[pairs >= 0]
        keys = rng.exponential(size=len(pairs)) / self._weights_of_drive[pairs]
        return pairs[np.argsort(keys)[:count]]

    def _simulated_apart(self, batch: TrainingBatch) -> NDArray[np.bool_]:
        foreign = batch.scene[:, None] != batch.scene[None, :]
        return foreign | self.far.pairs(batch.poses, batch.poses)


def _joined(simulated: TrainingBatch, simulated_apart: NDArray[np.bool_], own: TrainingBatch) -> TrainingBatch:
    """Return both batches as one; images of different scenes are certainly apart."""
    count = len(simulated.rgb)
    apart = np.ones((count + len(own.rgb),) * 2, bool)
    apart[:count, :count] = simulated_apart
    apart[count:, count:] = own.apart
    return TrainingBatch(
        rgb=np.concatenate([simulated.rgb, own.rgb]),
        depth_mm=np.concatenate([simulated.depth_mm, own.depth_mm]),
        poses=np.concatenate([simulated.poses, own.poses]),
        scene=np.concatenate([simulated.scene, own.scene]),
        sources=np.concatenate([simulated.sources, own.sources + count]),
        targets=np.concatenate([simulated.targets, own.targets + count]),
        reachable=np.concatenate([simulated.reachable, own.reachable]),
        apart=apart,
    )


def _pair_table(drive: LabelledTrajectory, reach: int) -> NDArray[np.int64]:
    """Return (N, 2 reach + 1): the labelled pair from each image to those up to `reach` before or after it, or -1."""
    table = np.full((len(drive.poses), 2 * reach + 1), -1)
    table[drive.sources, drive.targets - drive.sources + reach] = np.arange(len(drive.sources))
    return table


def _even_weights(drive: LabelledTrajectory) -> NDArray[np.float64]:
    """Return the weight of each labelled pair: positives even over distance, and as much as the negatives together."""
    waypoints = relative(drive.poses[drive.sources], drive.poses[drive.targets])
    bins = np.digitize(np.hypot(waypoints[:, 0], waypoints[:, 1]), DISTANCE_BINS_M)
    kind = np.where(drive.reachable, bins, len(DISTANCE_BINS_M) + 1)
    count = np.bincount(kind, minlength=len(DISTANCE_BINS_M) + 2)
    wish = np.full(len(count), 0.5 / max((count[:-1] > 0).sum(), 1))
    wish[-1] = 0.5
    return np.minimum(wish / np.maximum(count, 1) * len(kind), 10)[kind]
