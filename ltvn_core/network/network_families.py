"""The registry of network families: from a name to layer sizes and modules.

A new family needs a description in `architecture`, a subclass of `BaseNetwork`, and one line in `_FAMILIES`.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import torch

from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import (
    AnyArchitecture,
    ContrastiveArchitecture,
    EnsembleArchitecture,
    PairArchitecture,
    StackedArchitecture,
)
from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.ensemble_network import ContrastiveNetwork, EnsembleNetwork
from ltvn_core.network.pair_network import PairNetwork
from ltvn_core.network.stacked_network import StackedNetwork

_FAMILIES: Mapping[type[AnyArchitecture], Callable[[Any], AnyNetwork]] = {
    PairArchitecture: PairNetwork,
    StackedArchitecture: StackedNetwork,
    EnsembleArchitecture: EnsembleNetwork,
    ContrastiveArchitecture: ContrastiveNetwork,
}
_ARCHITECTURES: dict[str, type[AnyArchitecture]] = {each().name: each for each in _FAMILIES}

_MAX_WIDTH = 65_536
"""No layer is wider; a description that says so is damaged."""

NETWORK_FAMILIES = tuple(_ARCHITECTURES)
"""The names of all families."""


def build_network(size: AnyArchitecture) -> AnyNetwork:
    """Return a new network, its weights drawn by torch's generator."""
    return _FAMILIES[type(size)](size)


def extend_network(below: AnyNetwork, size: EnsembleArchitecture, seed: int) -> AnyNetwork:
    """Return a network that adds new layers to a trained one, their weights drawn with `seed`."""
    torch.manual_seed(seed)
    same = {each.name: getattr(below.size, each.name) for each in fields(below.size) if each.name != "name"}
    network = build_network(replace(size, **same))
    network.load_state_dict(below.state_dict(), strict=False)
    return network


def default_architecture(family: str) -> AnyArchitecture:
    """Return the default sizes of a family. Raises WeightsError for an unknown family."""
    if family not in _ARCHITECTURES:
        raise WeightsError(f"made for the architecture {family!r}; this version knows {', '.join(NETWORK_FAMILIES)}.")
    return _ARCHITECTURES[family]()


def read_architecture(description: Mapping[str, Any]) -> AnyArchitecture:
    """Return the sizes written as a mapping. Raises WeightsError if the family is unknown or a size is missing."""
    kind = type(default_architecture(str(description.get("name"))))
    try:
        sizes: dict[str, Any] = {each.name: int(description[each.name]) for each in fields(kind) if each.name != "name"}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise WeightsError(f"the description of the architecture is damaged ({error}).") from error
    if wrong := {name: size for name, size in sizes.items() if not 0 < size <= _MAX_WIDTH}:
        raise WeightsError(f"the architecture has impossible sizes: {wrong!s:.100}; each is 1 to {_MAX_WIDTH:,}.")
    return kind(**sizes)
