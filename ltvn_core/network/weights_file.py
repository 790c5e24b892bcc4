"""Weights on disk: a safetensors file with a model card beside it. Nothing is unpickled.

PyTorch is imported only where weights are read or written, so that cards can be read without it.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ltvn_core.atomic_files import file_aside
from ltvn_core.errors import WeightsError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS, shipped_weights
from ltvn_core.structured_text import parse_json

if TYPE_CHECKING:
    from ltvn_core.network.base_network import AnyNetwork

SCHEMA = "ltvn-weights-1"
"""Name of the file format; files of another format are refused."""


def save_weights(
    network: "AnyNetwork", path: Path, card: Mapping[str, Any] | None = None, *, added_to: Path | None = None
) -> str:
    """Write weights, and their card if there is one, and return the fingerprint.

    For a network that was `added_to` shipped weights, only the tensors that differ from these are written, matrices in
    half precision. Old files stay until the new ones are complete on disk. A card of other weights is deleted before
    the new weights replace the old ones, even if the new weights have no card. Raises WeightsError if the files cannot
    be written.
    """
    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load_file, save_file

    # One entry only: safetensors writes several in random order, and equal weights must have equal fingerprints.
    described = {"schema": SCHEMA, **asdict(network.size)}
    state = {name: value.detach().cpu().contiguous() for name, value in network.state_dict().items()}
    if added_to is not None:
        old = load_file(added_to)
        added = {name: value for name, value in state.items() if name not in old or not torch.equal(value, old[name])}
        state = {name: value.half() if value.dim() > 1 else value for name, value in added.items()}
        described["added_to"] = {"name": added_to.stem, "fingerprint": weights_fingerprint(added_to)}
    metadata = {"ltvn": json.dumps(described)}
    try:
        with file_aside(path) as weights, file_aside(card_path(path)) as text:
            save_file(state, weights, metadata)
            fingerprint, keeps_card = weights_fingerprint(weights), False
            if card is not None:
                _write_card(text, {"fingerprint": fingerprint, **card})
            with suppress(WeightsError):  # A card that cannot be read belongs to no weights.
                keeps_card = read_card(path).get("fingerprint") == fingerprint
            if not keeps_card:
                card_path(path).unlink(missing_ok=True)
            os.replace(weights, path)
            if card is not None:
                os.replace(text, card_path(path))
    except (OSError, SafetensorError) as error:
        raise WeightsError(f"{path}: the weights could not be written ({error}); free some space.") from error
    return fingerprint


def load_weights(path: Path) -> "AnyNetwork":
    """Load a network. Raises WeightsError for a file that is missing, truncated, or of another format or family."""
    import torch
    from safetensors import SafetensorError, safe_open
    from safetensors.torch import load_file

    from ltvn_core.network.network_families import build_network, read_architecture

    if not path.is_file():
        raise WeightsError(_no_weights(path))
    try:
        with safe_open(path, framework="pt") as file:
            described = _description(file.metadata() or {}, path)
        state = load_file(path)
        if "added_to" in described:
            state = {**load_file(_weights_below(described["added_to"], path)), **state}
    except (OSError, SafetensorError) as error:
        raise WeightsError(
            f"{path}: not a complete safetensors file ({error}); fetch or train the weights again."
        ) from error
    try:
        network = build_network(read_architecture(described))
        network.load_state_dict(state)
    except WeightsError as error:
        raise WeightsError(f"{path}: {error}") from error
    except (RuntimeError, ValueError, TypeError, AssertionError, ZeroDivisionError, MemoryError) as error:
        first = (str(error).splitlines() or [type(error).__name__])[:2]
        raise WeightsError(
            f"{path}: the weights do not fit the architecture in their metadata "
            f"({' '.join(map(str.strip, first)):.200}); fetch or train them again."
        ) from error
    if not all(torch.isfinite(value).all() for value in state.values()):
        raise WeightsError(f"{path}: the weights hold numbers that are not finite; train them again.")
    return network.eval()


def _weights_below(named: Any, path: Path) -> Path:
    """Return the shipped weights that a file adds layers to. Raises WeightsError if those of this version differ."""
    wanted = named if isinstance(named, dict) else {}
    below = shipped_weights(Path(str(wanted.get("name"))).name)
    if not below.is_file() or weights_fingerprint(below) != wanted.get("fingerprint"):
        raise WeightsError(
            f"{path}: adds layers to the weights {wanted.get('fingerprint')}, but {below.name} of this version is "
            "different; train the layers again with `ltvn train --system`."
        )
    return below


def _no_weights(path: Path) -> str:
    if path.parent == SHIPPED_WEIGHTS.parent:
        return (
            f"{path}: the installed package does not include the weights of the baselines. Use a checkout of the "
            f"repository, or train them with `ltvn train --system {path.stem}` and name them with --weights."
        )
    return f"{path}: there are no weights; train some with `ltvn train` or name another file."


def weights_fingerprint(path: Path) -> str:
    """Return the first 12 hexadecimal digits of the file's SHA-256. Raises WeightsError if there is no file."""
    if not path.is_file():
        raise WeightsError(_no_weights(path))
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


def card_path(path: Path) -> Path:
    """Return the path of the card of weights. Raises WeightsError for a path without a file name, such as /."""
    if not path.name:
        raise WeightsError(_no_weights(path))
    return path.with_suffix(".card.json")


def read_card(path: Path) -> dict[str, Any]:
    """Return the card of weights, empty if there is none. Raises WeightsError if it cannot be read as JSON."""
    try:
        card = parse_json(card_path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise WeightsError(f"{card_path(path)}: not a readable card ({error}).") from error
    if not isinstance(card, dict):
        raise WeightsError(
            f"{card_path(path)}: not a card, which is a JSON object with a fingerprint; move the file away, or restore "
            "it from a copy."
        )
    return card


def matching_card(path: Path) -> dict[str, Any]:
    """Return the card of weights, empty if the card beside them belongs to other weights. Raises WeightsError."""
    card = read_card(path)
    return card if path.is_file() and card.get("fingerprint") == weights_fingerprint(path) else {}


def _write_card(path: Path, card: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


def _description(metadata: Mapping[str, str], path: Path) -> dict[str, Any]:
    try:
        found = parse_json(metadata["ltvn"])
    except (KeyError, ValueError):
        found = {}
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        schema = found.get("schema", "something else") if isinstance(found, dict) else "something else"
        raise WeightsError(f"{path}: holds {schema!r}, not {SCHEMA!r}.")
    return found
