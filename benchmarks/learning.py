"""What it costs to learn from a pair of images, and what is gained by encoding each image once per step."""

import numpy as np

from benchmarks.measurement import Measurement, alternating, measured
from benchmarks.unoptimized_training import UnoptimizedTrainer
from ltvn_core.network.allocator import retain_freed_memory
from ltvn_core.network.optimization.scene_images import SceneImages
from ltvn_core.network.optimization.trainer import Hyperparameters, Trainer
from ltvn_core.network.training_data.pose_sampling import DatasetScene
from ltvn_core.network.training_data.shards import DatasetRecipe
from ltvn_core.network.training_examples import BatchSampler
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene_registry import load_scene


def learn() -> list[Measurement]:
    """Compare training's pairs per second with a plain float32 loop of the same network that encodes both images."""
    scene = load_scene("demo")
    shard = DatasetRecipe(clusters=40).make(DatasetScene(scene.name, scene.clearance, open_renderer(scene)))
    retain_freed_memory()
    sampler, trainer, plain = BatchSampler([shard]), Trainer(Hyperparameters()), UnoptimizedTrainer()
    trainer.step(sampler, 0.5)
    pairs = trainer.pairs
    images = SceneImages([shard])
    batch = sampler.draw(np.random.default_rng(0), groups=10, pairs_per_group=18)
    ratio = alternating(lambda: trainer.step(sampler, 0.5), lambda: plain.step(batch, images), 3)
    faster = ratio * pairs / plain.pairs
    return [measured("training: pairs per second against a plain loop", faster, "x more", at_least=2)]
