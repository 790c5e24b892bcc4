"""What it costs to learn from a pair of images, and what is gained by encoding each image once per step."""

import numpy as np
import torch

from ltvn_core.benchmarks.measurement import Measurement, alternating, measured
from ltvn_core.data.generate import DatasetRecipe, make_shard
from ltvn_core.data.worlds import World
from ltvn_core.model.examples import Batch, ExamplePool
from ltvn_core.model.learner import Learner, LearningPlan
from ltvn_core.model.loss import pair_loss
from ltvn_core.model.memory import keep_freed_memory
from ltvn_core.model.network import PairNetwork
from ltvn_core.model.precision import choose_precision
from ltvn_core.model.predictor import images_to_tensors
from ltvn_core.sim.camera import open_camera
from ltvn_core.sim.scenes import load_scene

_PLAIN_PAIRS = 64
"""Pairs in a batch of the plain loop."""


def learn() -> list[Measurement]:
    """Compare training's pairs per second with a plain float32 loop of the same network that encodes both images."""
    scene = load_scene("demo")
    shard = make_shard(World(scene.name, scene.clearance, open_camera(scene)), DatasetRecipe(clusters=40))
    keep_freed_memory()
    pool, learner = ExamplePool([shard]), Learner(LearningPlan())
    precision = choose_precision(learner.network)
    plain = _Plain()
    learner.step(pool, precision, 0.5)  # The first step prepares the convolutions.
    before = learner.pairs
    learner.step(pool, precision, 0.5)
    pairs = learner.pairs - before
    batch = pool.draw(np.random.default_rng(0), groups=10, pairs_per_group=18)
    ratio = alternating(lambda: learner.step(pool, precision, 0.5), lambda: plain.step(batch), 3)
    return [
        measured("training: pairs per second against a plain loop", ratio * pairs / _PLAIN_PAIRS, "x more", at_least=2)
    ]


class _Plain:
    """Learns from every pair by itself: both images encoded in float32, nothing shared."""

    def __init__(self) -> None:
        self.network = PairNetwork()
        self.optimiser = torch.optim.AdamW(self.network.parameters(), 1e-3)

    def step(self, batch: Batch) -> None:
        """Learn from the first pairs of a batch."""
        sources, targets = batch.sources[:_PLAIN_PAIRS], batch.targets[:_PLAIN_PAIRS]
        here, there = (
            self.network.encode(*images_to_tensors(batch.rgb[rows], batch.depth_mm[rows] / np.float32(1000)))
            for rows in (sources, targets)
        )
        output = self.network.compare(here, there)
        reachable = torch.from_numpy(batch.reachable[:_PLAIN_PAIRS]).float()
        waypoints = torch.from_numpy(batch.waypoints(sources, targets)).float()
        self.optimiser.zero_grad(set_to_none=True)
        pair_loss(output.logit, output.pose, reachable, waypoints, alpha=3.0, beta=3.0).backward()
        self.optimiser.step()
