"""Paths of the weights in the package. Needs no torch."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "weights"


def shipped_weights(name: str) -> Path:
    """Return the path of the weights with this name in the package."""
    return _FOLDER / f"{name}.safetensors"


SHIPPED_WEIGHTS = shipped_weights("ltvn")
"""The weights of the paper's own system, which are the default everywhere."""
