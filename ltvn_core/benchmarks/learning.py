"""What it costs to learn from a pair of images, and what is gained by encoding each image once per step."""

import numpy as np

from ltvn_core.benchmarks.measurement import Measurement, alternating, measured
from ltvn_core.data.generate import DatasetRecipe, make_shard
from ltvn_core.data.worlds import World
from ltvn_core.model.examples import ExamplePool
from ltvn_core.model.learner import Learner
from ltvn_core.model.learning_plan import LearningPlan
from ltvn_core.model.memory import keep_freed_memory
from ltvn_core.model.plain_loop import PlainLoop
from ltvn_core.model.precision import choose_precision
from ltvn_core.sim.camera import open_camera
from ltvn_core.sim.scenes import load_scene


def learn() -> list[Measurement]:
    """Compare training's pairs per second with a plain float32 loop of the same network that encodes both images."""
    scene = load_scene("demo")
    shard = make_shard(World(scene.name, scene.clearance, open_camera(scene)), DatasetRecipe(clusters=40))
    keep_freed_memory()
    pool, learner, plain = ExamplePool([shard]), Learner(LearningPlan()), PlainLoop()
    precision = choose_precision(learner.network)
    learner.step(pool, precision, 0.5)
    pairs = learner.pairs
    batch = pool.draw(np.random.default_rng(0), groups=10, pairs_per_group=18)
    ratio = alternating(lambda: learner.step(pool, precision, 0.5), lambda: plain.step(batch), 3)
    faster = ratio * pairs / plain.pairs
    return [measured("training: pairs per second against a plain loop", faster, "x more", at_least=2)]
