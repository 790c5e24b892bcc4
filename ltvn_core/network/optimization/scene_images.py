"""The images of the training scenes on the device of the network, so that a step only sends the rows of its batch."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ltvn_core.network.device import CPU, has_room, to_tensor
from ltvn_core.network.training_examples import SceneExamples


class SceneImages:
    """Colours in 8 bits and depths in millimetres; on the CPU they share memory with the scenes."""

    def __init__(self, scenes: Sequence[SceneExamples], device: torch.device = CPU) -> None:
        """Copy the images of all scenes to a device, if it has room for them."""
        self.scenes = scenes
        self._device = device
        place = device if has_room(device, sum(each.rgb.nbytes + each.depth_mm.nbytes for each in scenes)) else CPU
        self._rgb = [to_tensor(each.rgb, place) for each in scenes]
        # As signed numbers, because PyTorch can do little with unsigned ones of 16 bits.
        self._depth = [to_tensor(each.depth_mm.view(np.int16), place) for each in scenes]

    def take(self, images: Sequence[tuple[int, NDArray[np.intp]]]) -> tuple[Tensor, Tensor]:
        """Return rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres of the given rows of numbered scenes."""
        rgb, depth = (
            torch.cat([store[scene].index_select(0, to_tensor(rows, store[scene].device)) for scene, rows in images])
            for store in (self._rgb, self._depth)
        )
        rgb, depth = rgb.to(self._device), depth.to(self._device)
        return rgb.permute(0, 3, 1, 2).float() / 255, (depth.int() & 0xFFFF).float() / 1000
