"""Chooses the device of a network (graphics card or CPU), logs it once, and moves and keeps arrays there."""

import logging
import os
from functools import cache
from threading import Lock

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ltvn_core.errors import OptionError

log = logging.getLogger(__name__)

CPU = torch.device("cpu")

_MAX_THREADS = 4
"""Upper limit of torch's threads; more do not make batches of a predictor's size faster. At most half of the cores are
used: threads wait for each other at every layer, so any other busy program would slow them down several times."""


@cache
def choose_device(wanted: str = "auto") -> torch.device:
    """Return the device `cuda`, `mps` or `cpu`; `auto` is `cuda` where there is one, else `cpu`. Raises OptionError."""
    there = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    found = [name for name, is_there in there.items() if is_there]
    if wanted not in ("auto", *found):
        raise OptionError(f"--device {wanted}: PyTorch finds only {', '.join(found)} here; leave --device out.")
    device = torch.device(wanted if wanted != "auto" else "cuda" if there["cuda"] else "cpu")
    torch.backends.cudnn.allow_tf32 = False  # Answers stay within 0.005 of the CPU's.
    log.info("The network runs on %s.", torch.cuda.get_device_name(device) if device.type == "cuda" else device.type)
    return device


def device_of(network: nn.Module) -> torch.device:
    """Return the device of a network's weights."""
    return next(network.parameters()).device


def to_tensor(array: NDArray[np.generic] | Tensor, device: torch.device = CPU) -> Tensor:
    """Return an array as a tensor on a device; on the CPU they share memory."""
    return array if isinstance(array, Tensor) else torch.from_numpy(np.ascontiguousarray(array)).to(device)


def has_room(device: torch.device, size: int) -> bool:
    """Return whether `size` bytes fill at most half of what a graphics card has free; true on other devices."""
    return device.type != "cuda" or size <= torch.cuda.mem_get_info(device)[0] / 2


class RowsOnDevice:
    """A copy of rows of an array on a device; each row is copied when it is first asked for, and after a change."""

    def __init__(self, device: torch.device) -> None:
        self.copied = 0
        """Number of rows copied so far."""
        self._device = device
        self._rows = torch.empty(0)
        self._stamps = np.empty(0, np.int64)
        self._lock = Lock()

    @torch.inference_mode()
    def take(self, array: NDArray[np.generic], stamps: NDArray[np.int64], rows: NDArray[np.intp]) -> Tensor | None:
        """Return rows (N,) of an array (M, F), None if it is too large; equal stamps (M,) above 0 mean equal rows."""
        with self._lock:
            if len(self._stamps) < len(array):
                if not has_room(self._device, array.nbytes):
                    return None
                self._rows = to_tensor(np.empty(0, array.dtype), self._device).new_empty(array.shape)
                self._stamps = np.zeros(len(array), np.int64)  # All are copied again; arrays grow by doubling.
            missing = rows[self._stamps[rows] != stamps[rows]]
            if len(missing):
                self._rows[to_tensor(missing, self._device)] = to_tensor(array[missing], self._device)
                self._stamps[missing] = stamps[missing]
                self.copied += len(missing)
            return self._rows[to_tensor(rows, self._device)]


def limit_threads() -> None:
    """Limit PyTorch's threads to the number that still makes a small network faster."""
    torch.set_num_threads(max(1, min(torch.get_num_threads(), (os.cpu_count() or 1) // 2, _MAX_THREADS)))
