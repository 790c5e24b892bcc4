"""What one learning step does: the numbers of Eq. 1, of the batch and of the optimiser. Owns no behaviour."""

from dataclasses import dataclass, field

from ltvn_core.network.optimization.augmentation import Augmentation
from ltvn_core.network.optimization.hard_negative_mining import FarCriterion


@dataclass(frozen=True, slots=True)
class Hyperparameters:
    """What one step does (all values ours; the paper states none)."""

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
    """Mined far pairs per step, each bringing both its clusters along."""
    hard: int = 40
    """Far pairs of the step's images that look most alike to the network's rough score, or any if it has none."""
    hardness: float = 1.5
    """How much those that look alike are preferred; 0 draws them at random."""
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
    """What is certainly not reachable."""
    augmentation: Augmentation = field(default_factory=Augmentation)
    """Changes of the images."""
