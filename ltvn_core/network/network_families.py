"""The registry of network families: from a name to layer sizes and modules.

A new family needs a description in `architecture`, a subclass of `BaseNetwork`, and one line here.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import AnyArchitecture, PairArchitecture, StackedArchitecture
from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.pair_network import PairNetwork
from ltvn_core.network.stacked_network import StackedNetwork

_ARCHITECTURES: dict[str, type[AnyArchitecture]] = {
    each().name: each for each in (PairArchitecture, StackedArchitecture)
}

_MAX_WIDTH = 65_536
"""No layer is wider; a description that says so is damaged."""

NETWORK_FAMILIES = tuple(_ARCHITECTURES)
"""The names of all families."""


def build_network(size: AnyArchitecture) -> AnyNetwork:
    """Return a new network, its weights drawn by torch's generator."""
    return PairNetwork(size) if isinstance(size, PairArchitecture) else StackedNetwork(size)


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
