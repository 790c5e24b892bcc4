"""Chooses where a network learns, the processors or a graphics card, and says so.

Owns the choice and the way of arrays to the chosen device. Navigation itself always runs on the processors.
"""

import logging

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

log = logging.getLogger(__name__)

CPU = torch.device("cpu")


def gpu_count() -> int:
    """Return how many graphics cards torch can use."""
    return torch.cuda.device_count() if torch.cuda.is_available() else 0


def choose_device(rank: int = 0) -> torch.device:
    """Return the graphics card of a process where there is one, else the processors, and make it torch's default."""
    if gpu_count() == 0:
        log.info("learning on the processors, %d threads per process", torch.get_num_threads())
        return CPU
    device = torch.device("cuda", rank % gpu_count())
    torch.cuda.set_device(device)
    torch.set_default_device(device)  # Where new tensors are born; those made of arrays go through `to_tensor`.
    log.info("learning on %s: %s", device, torch.cuda.get_device_name(device))
    return device


def device_of(network: nn.Module) -> torch.device:
    """Return where a network's weights are."""
    return next(network.parameters()).device


def to_tensor(array: NDArray[np.generic], device: torch.device = CPU) -> Tensor:
    """Return an array as a tensor on a device; on the processors they share their memory."""
    return torch.from_numpy(np.ascontiguousarray(array)).to(device)
