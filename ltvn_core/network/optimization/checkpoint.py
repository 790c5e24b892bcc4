"""Checkpoints from which an interrupted training continues: safetensors files, written aside and then renamed.

A checkpoint has the state of the trainer and the time spent; everything else follows from the plan.
"""

import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import WeightsError
from ltvn_core.network.optimization.trainer import Trainer
from ltvn_core.network.training_examples import HardNegative
from ltvn_core.structured_text import parse_json

SCHEMA = "ltvn-checkpoint-1"
"""Name of the file format; another one is refused."""


def save_checkpoint(trainer: Trainer, path: Path, *, seconds: float) -> None:
    """Write the state of a trainer. Raises WeightsError if it cannot be written; the old file then stays."""
    metadata = {
        "schema": SCHEMA,
        "plan": _plan_text(trainer),
        "steps": str(trainer.steps),
        "pairs": str(trainer.pairs),
        "seconds": repr(seconds),
    }
    try:
        with atomic_replacement(path) as part:
            save_file(_tensors(trainer), part, metadata)
    except (OSError, SafetensorError) as error:
        raise WeightsError(f"{path}: the checkpoint could not be written ({error}); free some space.") from error


def restore_checkpoint(trainer: Trainer, path: Path) -> float:
    """Restore the state of a checkpoint in a new trainer of the same plan, and return the seconds spent before.

    Raises WeightsError for a file that is truncated, of another format, or of another plan.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except (OSError, SafetensorError) as error:
        raise WeightsError(f"{path}: not a whole checkpoint ({error}); delete it to begin anew.") from error
    if metadata.get("schema") != SCHEMA or metadata.get("plan") != _plan_text(trainer):
        raise WeightsError(
            f"{path}: made by another plan of training{_other_family(trainer, metadata)}; "
            "name another folder or delete it."
        )
    trainer.network.load_state_dict(_part(tensors, "network."))
    trainer.average.load_state_dict(_part(tensors, "average."))
    trainer.steps = int(metadata["steps"])
    trainer.pairs = int(metadata["pairs"])
    trainer.confusions = [HardNegative(*row) for row in tensors["confusions"].tolist()]
    _restore_optimiser(trainer, _part(tensors, "optimiser."))
    return float(metadata["seconds"])


def _tensors(trainer: Trainer) -> dict[str, Tensor]:
    state = {f"network.{name}": value for name, value in trainer.network.state_dict().items()}
    state |= {f"average.{name}": value for name, value in trainer.average.state_dict().items()}
    for number, entry in trainer.optimiser.state_dict()["state"].items():
        state |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in entry.items()}
    state["confusions"] = torch.tensor(trainer.confusions, dtype=torch.int64).reshape(-1, 3)
    return {name: value.detach().cpu().clone(memory_format=torch.contiguous_format) for name, value in state.items()}


def _restore_optimiser(trainer: Trainer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        number, field = name.split(".", 1)
        state.setdefault(int(number), {})[field] = value
    trainer.optimiser.load_state_dict({**trainer.optimiser.state_dict(), "state": state})


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def _other_family(trainer: Trainer, metadata: dict[str, str]) -> str:
    """Say that a checkpoint is of another family of networks, or nothing."""
    try:
        found = str(parse_json(metadata["plan"])[1]["name"])
    except (KeyError, IndexError, TypeError, ValueError):
        return ""
    wanted = trainer.network.size.name
    return "" if found == wanted else f" (of the architecture {found!r}, not {wanted!r})"


def _plan_text(trainer: Trainer) -> str:
    return json.dumps([asdict(trainer.plan), asdict(trainer.network.size)], sort_keys=True)
