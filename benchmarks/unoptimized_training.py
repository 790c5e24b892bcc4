"""Learning without any of the savings: the yardstick for training's speed.

Every pair is learned from by itself, both images encoded in float32, nothing shared. Only the benchmarks use it.
"""

import torch

from ltvn_core.network.loss import cross_entropy, pair_loss
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.optimization.scene_images import SceneImages
from ltvn_core.network.training_examples import TrainingBatch


class UnoptimizedTrainer:
    """A network and its optimiser. Learns by Eq. 1 alone."""

    def __init__(self, *, pairs: int = 64) -> None:
        self.pairs = pairs
        self.network = PairNetwork()
        self.optimiser = torch.optim.AdamW(self.network.parameters(), 1e-3)

    def step(self, batch: TrainingBatch, images: SceneImages) -> None:
        """Learn from the first `pairs` pairs of a batch."""
        rgb, depth = images.take(batch.images)
        sources, targets = batch.sources[: self.pairs], batch.targets[: self.pairs]
        here, there = (self.network.encode(rgb[rows], depth[rows]) for rows in (sources, targets))
        output = self.network.compare(here, there)
        reachable = torch.from_numpy(batch.reachable[: self.pairs]).float()
        waypoints = torch.from_numpy(batch.waypoints(sources, targets)).float()
        self.optimiser.zero_grad(set_to_none=True)
        doubt = cross_entropy(output.logit, reachable)
        pair_loss(doubt, output.pose, reachable, waypoints, alpha=3.0, beta=3.0).backward()
        self.optimiser.step()
