"""Chooses the device of a network (graphics card or CPU), logs it once, and moves arrays to it."""

import logging
import os
from functools import cache

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


def to_tensor(array: NDArray[np.generic], device: torch.device = CPU) -> Tensor:
    """Return an array as a tensor on a device; on the CPU they share memory."""
    return torch.from_numpy(np.ascontiguousarray(array)).to(device)


def limit_threads() -> None:
    """Limit PyTorch's threads to the number that still makes a small network faster."""
    torch.set_num_threads(max(1, min(torch.get_num_threads(), (os.cpu_count() or 1) // 2, _MAX_THREADS)))
