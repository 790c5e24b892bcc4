"""The registry entry of a navigation system, with everything that the rest of the program needs to know about it.

`ltvn_core.systems.registry` finds entries by name.
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
"""Function that returns a system with the thresholds of a method."""


@dataclass(frozen=True, slots=True)
class TemporalLearning:
    """Settings for a network that learns from the number of steps between two images of a drive, without poses."""

    rule: "TemporalLabelRule"
    """Rule that labels a pair of images by the number of steps between them."""
    even_distances: bool = True
    """Whether to draw positives uniformly over distance; False draws pairs as often as they occur."""
    added: "EnsembleArchitecture | None" = None
    """Trainable layers on top of the frozen default network; None trains the whole network."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemEntry:
    """A navigation system by name, with its factory, its label and its network."""

    name: str
    """Name on the command line and in maps, recordings and results."""
    label: str
    """Name in tables and figures."""
    factory: SystemFactory
    """Function that returns the system with the thresholds of a method."""
    weights: Path = SHIPPED_WEIGHTS
    """Default weights of its network."""
    learning: TemporalLearning | None = None
    """Settings if its network learns from time; None if it learns from odometry, as in the paper."""
    preset_in_label: bool = False
    """Whether tables must name the preset, because presets change the system itself and not only the navigator."""

    def weights_for(self, predictor: str, wanted: Path | None = None) -> Path | None:
        """Return the weights for opening a predictor: the wanted ones, else the system's own for `network`.

        Other predictors use their own weights (None).
        """
        from ltvn_core.predictors.opening import NETWORK

        return wanted or (self.weights if predictor == NETWORK else None)
