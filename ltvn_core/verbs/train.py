"""`ltvn train`: trains weights on a dataset, and writes a card for them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.training.held_out_scenes import (
    CLUSTERS_PER_SCENE,
    IMAGES_PER_DRIVE,
    TEST_SCENES,
)
from ltvn_core.verbs.option_types import SystemName
from ltvn_core.verbs.outputs import FilledFolder, NewWeights
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class TrainVerb(Verb):
    """Train the network on a dataset, or with --system that of a rival on random walks; continues from the checkpoint
    in `work` if there is one."""

    job = "ltvn_core.verbs.jobs.train:train_network"

    data: Path = Path("data")
    """The folder of `ltvn dataset`; labelled pairs of the test scenes are stored in its subfolder `unseen`, walks in
    `walks`, one file per scene, made where they are missing and used by all rivals."""
    system: SystemName = DEFAULT_SYSTEM
    """Another system trains its network on its own temporal labels, on random walks. SPTM: whether two images are close
    in time. ViNG: the time from one image to the other. SoRB: the same, by an ensemble of three. HTM: which of many
    images comes soon after."""
    fresh: bool = False
    """With --system: start from random weights, as in the paper, instead of from the shipped weights; 1,500 steps are a
    good start."""
    architecture: Literal["aligned-pairs", "stacked"] = "aligned-pairs"
    """The network: matches and aligns tokens of the two images, or the paper's plain network on both images stacked."""
    output: NewWeights | None = None
    """The weights to write; a card is written beside them."""
    work: FilledFolder | None = None
    """Folder for checkpoints, curves and validation figures; by default data/training, or with --system a folder below
    the walks."""
    minutes: float | None = None
    """Time for training, in minutes; by default 45, or 8 with --system."""
    steps: int | None = None
    """Train for this number of steps instead; takes longer on a slower machine, but gives the same weights."""
    processes: int | None = None
    """With --system: number of scenes that are rendered at the same time, by default two."""
    bfloat16: bool = False
    """Train in mixed precision: faster on a graphics card or processor made for bfloat16, and other weights."""
    seed: int = 0
    """Seed of initial weights, walks, pairs, batches and augmentation."""
    evaluate: bool = False
    """Do not train; measure existing weights."""
    weights: Path | None = None
    """With --evaluate: the weights to measure instead of the shipped ones."""
    stacked: Path | None = None
    """With --evaluate: weights of a plain network, made with --architecture stacked, to measure for comparison."""
    scenes: tuple[str, ...] = TEST_SCENES
    """With --evaluate: the scenes to measure on, by name or by the path of a mesh."""
    clusters: int = CLUSTERS_PER_SCENE
    """With --evaluate: number of clusters of labelled pairs in each scene."""
    images: int = IMAGES_PER_DRIVE
    """With --evaluate: number of images of the drive through each scene."""
