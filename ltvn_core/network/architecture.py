"""The layer sizes of the networks: a frozen description per family, stored with the weights to rebuild the modules."""

from dataclasses import dataclass
from math import radians

from ltvn_core.cameras.camera_model import CameraModel

NETWORK_CAMERA = CameraModel.from_fov(96, 72, radians(69.4), height_m=0.6)
"""The level camera of the training images; inputs of the networks must come from the same camera."""

STRIDE = 8
"""Pixels per token along each axis: the encoder halves the image three times."""

DEPTH_STRIDE = 4
"""Pixels per sample of the depth that is kept with the features for checking a waypoint."""


@dataclass(frozen=True, slots=True)
class PairArchitecture:
    """Widths of the layers of `PairNetwork` (all ours; the paper does not state its network)."""

    name: str = "aligned-pairs"
    """Family of the network; it decides what is built when weights are read."""
    stem: int = 32
    """Channels at half resolution."""
    middle: int = 48
    """Channels at a quarter of the resolution."""
    tokens: int = 96
    """Channels at an eighth of the resolution: the width of a token."""
    heads: int = 4
    """Heads of the self-attention that gives every token the whole image as context."""
    descriptor: int = 64
    """Width of the unit vectors that are matched between two images."""
    value: int = 32
    """Width of the value vector that a token passes to its match."""
    place: int = 64
    """Width of the per-image vectors whose product is a cheap score for a pair."""
    hidden: int = 64
    """Width of the pair head's per-token layers."""

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of tokens."""
        return NETWORK_CAMERA.height // STRIDE, NETWORK_CAMERA.width // STRIDE

    @property
    def token_count(self) -> int:
        """Tokens per image."""
        return self.grid[0] * self.grid[1]

    @property
    def depth_grid(self) -> tuple[int, int]:
        """Rows and columns of the kept depth."""
        return NETWORK_CAMERA.height // DEPTH_STRIDE, NETWORK_CAMERA.width // DEPTH_STRIDE

    @property
    def depth_count(self) -> int:
        """Samples of the kept depth per image."""
        return self.depth_grid[0] * self.depth_grid[1]


@dataclass(frozen=True, slots=True)
class StackedArchitecture:
    """Widths of the layers of `StackedNetwork`: a ResNet-18 made narrower for images of 96 x 72."""

    name: str = "stacked"
    """Family of the network; it decides what is built when weights are read."""
    stem: int = 32
    """Channels at half resolution."""
    quarter: int = 32
    """Channels at 1/4 of the resolution."""
    eighth: int = 64
    """Channels at 1/8 of the resolution."""
    sixteenth: int = 128
    """Channels at 1/16 of the resolution."""
    last: int = 192
    """Channels after the last halving."""
    hidden: int = 128
    """Width of the fully connected layer before the output."""


@dataclass(frozen=True, slots=True)
class EnsembleArchitecture(PairArchitecture):
    """Layer widths of `EnsembleNetwork`: the trained backbone and the ensemble of output layers on top of it."""

    name: str = "ensemble"
    """Family of the network; it decides what is built when weights are read."""
    members: int = 3
    """Number of ensemble members, each a stack of output layers; SoRB has as many critics."""
    member_hidden: int = 64
    """Width of a member's first hidden layer, twice that of the second."""


@dataclass(frozen=True, slots=True)
class ContrastiveArchitecture(EnsembleArchitecture):
    """Layer widths of `ContrastiveNetwork`."""

    name: str = "contrastive"
    """Family of the network; it decides what is built when weights are read."""
    members: int = 1
    """A single member, which gives the score."""


AnyArchitecture = PairArchitecture | StackedArchitecture
"""The description of a network of any family."""
