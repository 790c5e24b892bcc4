"""Where the weights lie that come with the package. Owns their paths alone and needs no torch."""

from pathlib import Path

_FOLDER = Path(__file__).parent / "weights"


def shipped_weights(name: str) -> Path:
    """Return the path of the weights of that name in the package."""
    return _FOLDER / f"{name}.safetensors"


SHIPPED_WEIGHTS = shipped_weights("ltvn")
"""The weights of the paper's own system, which are the default everywhere."""
