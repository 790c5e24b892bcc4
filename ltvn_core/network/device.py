"""Chooses the device for training (GPU or CPU), logs it, and moves arrays to it. Navigation always runs on the CPU."""

import logging
import os

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

log = logging.getLogger(__name__)

CPU = torch.device("cpu")

_MAX_THREADS = 4
"""Upper limit of torch's threads; more do not make batches of a predictor's size faster. At most half of the cores are
used: threads wait for each other at every layer, so any other busy program would slow them down several times."""


def choose_device() -> torch.device:
    """Return a GPU if there is one, else the CPU, and make it torch's default device."""
    if not torch.cuda.is_available():
        log.info("training on the CPU, %d threads", torch.get_num_threads())
        return CPU
    device = torch.device("cuda", 0)
    torch.set_default_device(device)  # For new tensors; arrays are converted by `to_tensor`.
    log.info("training on %s", torch.cuda.get_device_name(device))
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
