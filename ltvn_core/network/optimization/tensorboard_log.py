"""Writes the curves of a training for TensorBoard, if it is installed.

Nothing reads them back: the checkpoint and `validation.jsonl` are the record of a training.
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)


class TensorBoardLog:
    """Named curves over the steps of one training."""

    def __init__(self, folder: Path) -> None:
        """Write into a folder; does nothing without TensorBoard."""
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            log.info("No curves for TensorBoard: it is not installed; `pip install tensorboard` adds it.")
            return
        self._writer = SummaryWriter(folder)
        log.info("Curves: tensorboard --logdir %s", folder)

    def add(self, step: int, **values: float) -> None:
        """Add a point to each of the named curves; two underscores separate group and name."""
        if self._writer is None:
            return
        for name, value in values.items():
            self._writer.add_scalar(name.replace("__", "/"), value, step)

    def add_metrics(self, step: int, group: str, metrics: Mapping[str, float]) -> None:
        """Add a point to each curve of a group."""
        self.add(step, **{f"{group}__{name}": value for name, value in metrics.items()})

    def close(self) -> None:
        """Write pending points and close the file."""
        if self._writer is not None:
            self._writer.close()
