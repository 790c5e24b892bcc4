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


def gpu_count() -> int:
    """Return the number of GPUs that torch can use."""
    return torch.cuda.device_count() if torch.cuda.is_available() else 0


def choose_device(rank: int = 0) -> torch.device:
    """Return the GPU of a process if there is one, else the CPU, and make it torch's default device."""
    if gpu_count() == 0:
        log.info("training on the CPU, %d threads per process", torch.get_num_threads())
        return CPU
    device = torch.device("cuda", rank % gpu_count())
    torch.cuda.set_device(device)
    torch.set_default_device(device)  # For new tensors; arrays are converted by `to_tensor`.
    log.info("training on %s: %s", device, torch.cuda.get_device_name(device))
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
