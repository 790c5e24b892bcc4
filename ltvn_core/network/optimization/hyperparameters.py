"""Hyperparameters of a training step: weights of the loss (Eq. 1), batch, optimiser."""

from dataclasses import dataclass, field

from ltvn_core.network.optimization.augmentation import Augmentation
from ltvn_core.network.optimization.hard_negative_mining import FarCriterion


@dataclass(frozen=True, slots=True)
class Hyperparameters:
    """Hyperparameters of a training step (all values are ours; the paper states none).

    The names of the fields are stored in model cards.
    """

    seed: int = 0
    """Seeds initial weights, batches and augmentation."""
    alpha: float = 3.0
    """Weight of the position error in Eq. 1."""
    beta: float = 3.0
    """Weight of the yaw error in Eq. 1."""
    matching: float = 0.15
    """Weight of the auxiliary loss on token matches, in networks that match."""
    place: float = 0.1
    """Weight of the auxiliary loss on the cheap place score, in networks that have one."""
    groups: int = 10
    """Clusters of images per step and process."""
    pairs_per_group: int = 18
    """Labelled pairs per cluster."""
    evened: bool = True
    """Draw positives evenly over distance and as many negatives; False draws pairs as they come."""
    confusions: int = 2
    """Hard negatives per step; the clusters of both images are added to the batch."""
    hard: int = 40
    """Far pairs of the step's images with the highest rough scores, or random ones if the network has no score."""
    hardness: float = 1.5
    """How strongly high scores are preferred; 0 draws at random."""
    random: int = 12
    """Far pairs drawn at random."""
    rate: float = 2e-3
    """Peak learning rate of AdamW."""
    warm_up: float = 0.03
    """Share of training over which the rate rises."""
    decay: float = 0.01
    """Weight decay."""
    average: float = 0.998
    """How much of the moving average of the weights stays at each step."""
    far: FarCriterion = field(default_factory=FarCriterion)
    """Pairs that are certainly negatives."""
    augmentation: Augmentation = field(default_factory=Augmentation)
    """Augmentation of the images."""
