"""`python -m benchmarks.device --device cuda`: the table "With a card" of docs/performance.md, measured anew.

Compares a device with one core of the same machine, then trains a network there. On eight cores and a card it takes at
most eight minutes; `--device cpu --minutes 0.2 --scenes 1 --clusters 8 --pairs 96` tries it out.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from benchmarks.measurement import seconds
from benchmarks.recording import demo_observations
from ltvn_core.cli import run_verb
from ltvn_core.network.device import choose_device
from ltvn_core.network.optimization.trainer import Hyperparameters, Trainer
from ltvn_core.network.optimization.training_loop import TrainingData, TrainingPlan, train
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.training_data.shards import DatasetRecipe, Shard, generate_shards, read_shard
from ltvn_core.network.training_examples import BatchSampler
from ltvn_core.training.held_out_scenes import VALIDATION_SCENES, drives
from ltvn_core.training.simulated_scenes import open_dataset_scene
from ltvn_core.types import Prediction
from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True)
class DeviceFigures:
    """What one device takes; times in milliseconds."""

    device: str
    encode_ms: float
    """An image, 256 at once."""
    compare_96_ms: float
    """One image with 96."""
    compare_many_ms: float
    """One image with `pairs` images."""
    steps_per_s: float
    """Steps of training a second."""


@dataclass(frozen=True)
class DeviceSummary:
    """Both columns of the table, and the training."""

    core: DeviceFigures
    card: DeviceFigures
    largest_difference: float
    """Largest difference of r between both."""
    images: int
    """Images learned from."""
    steps: int
    """Steps of the training; mining and validation take a part of its time."""
    validating: float
    """Share of the training's time that validation took."""
    auc: float
    position_median_m: float


@dataclass(frozen=True, kw_only=True)
class DeviceBench(Verb):
    """Measure a device against one core, and train there."""

    device: str = "auto"
    """The device: auto, cpu, cuda or mps."""
    minutes: float = 5.0
    """Minutes to train."""
    scenes: int = 8
    """Scenes to learn from."""
    clusters: int = 280
    """Clusters of images in each scene; 8 images each."""
    pairs: int = 4096
    """Images that one is compared with in the largest comparison."""
    processes: int = 8
    """Processes that render the scenes."""

    def run(self) -> Summary:
        """Render, measure and train."""
        device = choose_device(self.device)
        torch.set_num_threads(1)
        with TemporaryDirectory() as folder:
            names = [f"train-{number:02}" for number in range(self.scenes)]
            recipe = DatasetRecipe(clusters=self.clusters)
            paths = generate_shards(
                [*names, *VALIDATION_SCENES], open_dataset_scene, Path(folder), recipe, processes=self.processes
            )
            shards = [read_shard(path) for path in paths]
            learned, validation = shards[: self.scenes], shards[self.scenes :]
            core, expected = _measure("cpu", learned, self.pairs, 2)
            card, found = _measure(device.type, learned, self.pairs, 20 if device.type != "cpu" else 2)
            plan = TrainingPlan(minutes=self.minutes)
            seen = drives(VALIDATION_SCENES, images=150)
            result = train(TrainingData(learned, validation, seen), plan, Path(folder), device=device)
            *_, last = (Path(folder) / "validation.jsonl").read_text(encoding="utf-8").splitlines()
        assert result.best is not None, "training ends with a validation"
        return DeviceSummary(
            core=core,
            card=card,
            largest_difference=float(np.abs(found.reachability - expected.reachability).max()),
            images=sum(len(shard.poses) for shard in learned),
            steps=result.steps,
            validating=json.loads(last)["validating_s"] / result.seconds,
            auc=result.best.pairs.auc,
            position_median_m=result.best.pairs.position_median_m,
        )


def _measure(device: str, shards: list[Shard], pairs: int, repeats: int) -> tuple[DeviceFigures, Prediction]:
    """Measure the shipped network and the training of a new one; return also what 96 comparisons give."""
    predictor = load_predictor(prefilter_from=None, device=device)
    torch.set_num_threads(1)
    seen = demo_observations(256)
    features = predictor.encode(seen)
    few, many = (np.resize(features, (count, features.shape[1])) for count in (96, pairs))
    trainer, sampler = Trainer(Hyperparameters(), device=torch.device(device)), BatchSampler(shards)
    figures = DeviceFigures(
        device=device,
        encode_ms=1e3 * seconds(lambda: predictor.encode(seen), repeats) / len(seen),
        compare_96_ms=1e3 * seconds(lambda: predictor.predict(features[:1], few), repeats),
        compare_many_ms=1e3 * seconds(lambda: predictor.predict(features[:1], many), repeats),
        steps_per_s=1 / seconds(lambda: trainer.step(sampler, 0.5), repeats),
    )
    return figures, predictor.predict(features[:1], few)


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.device", DeviceBench))
