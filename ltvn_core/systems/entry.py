"""A registry entry of a navigation system: all that the rest of the program needs to know about it.

Owns the fields. The table of names is `ltvn_core.systems.registry`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS

if TYPE_CHECKING:  # The command line reads the names of systems and must not wait for numpy.
    from ltvn_core.config import Method
    from ltvn_core.graph.navigation_system import NavigationSystem
    from ltvn_core.network.architecture import EnsembleArchitecture
    from ltvn_core.network.training_data.temporal_rules import TemporalLabelRule


SystemFactory: TypeAlias = "Callable[[Method], NavigationSystem]"
"""Makes a system with the thresholds of a method."""


@dataclass(frozen=True, slots=True)
class TemporalLearning:
    """What a network learns by that knows no poses, only the steps between two images of a drive."""

    rule: "TemporalLabelRule"
    """Labels a pair of images by the steps between them."""
    even_distances: bool = True
    """Draw positives evenly over distance; False learns from pairs as often as they occur."""
    added: "EnsembleArchitecture | None" = None
    """Layers that learn in place of the shipped network, which stays as it is; None where all of it learns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemEntry:
    """A navigation system by name: how to make it, what readers call it, and the network that it takes."""

    name: str
    """What the command line, maps, recordings and results call it."""
    label: str
    """What tables and figures call it."""
    factory: SystemFactory
    """Returns the system with the thresholds of a method."""
    weights: Path = SHIPPED_WEIGHTS
    """Weights of its network that are used unless others are named."""
    learning: TemporalLearning | None = None
    """How its network learns by time; None where it learns by odometry, as the paper's does."""
    preset_in_label: bool = False
    """Whether readers must know the preset: True where presets change the system itself and not only the navigator."""

    def weights_for(self, predictor: str, wanted: Path | None = None) -> Path | None:
        """Return the weights that a predictor of that name is to be opened with: those wanted, else its own.

        Those of the system are of its network; other predictors bring theirs (None).
        """
        from ltvn_core.predictors.opening import NETWORK

        return wanted or (self.weights if predictor == NETWORK else None)
