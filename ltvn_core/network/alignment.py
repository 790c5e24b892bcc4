"""Weighted rigid alignment of points in the floor plane (SE(2) Procrustes): closed form, batched, differentiable.

Written as few products of small matrices, because a comparison of a few pairs takes as long as its operations are many.
"""

from typing import NamedTuple

import torch
from torch import Tensor


class PlanarMotion(NamedTuple):
    """A rigid motion in the floor plane for each of P pairs: the pose of the target in the source's frame."""

    shift: Tensor
    """(P, 2) metres."""
    turn: Tensor
    """(P, 2): cosine and sine."""

    def apply(self, points: Tensor) -> Tensor:
        """Transform points (P, N, 3) from the target's frame to the source's."""
        return torch.baddbmm(lifted(self.shift)[:, None], points, rotation(self.turn))

    def inverse(self) -> "PlanarMotion":
        """Return the inverse motion: the pose of the source in the target's frame."""
        back = self.turn * self.turn.new_tensor([1.0, -1.0])
        return PlanarMotion(-turned(self.shift, back), back)

    def detach(self) -> "PlanarMotion":
        """Return the same motion without gradient."""
        return PlanarMotion(self.shift.detach(), self.turn.detach())

    def numbers(self) -> Tensor:
        """Return (P, 4): dx, dy, sin, cos."""
        return torch.cat([self.shift, self.turn.flip(1)], dim=1)


def rotation(turn: Tensor) -> Tensor:
    """Return the matrices (P, 3, 3) by which rows of points are multiplied, from cosines and sines (P, 2)."""
    cos, sin = turn[:, :1], turn[:, 1:]
    zero = torch.zeros_like(cos)
    return torch.cat([cos, sin, zero, -sin, cos, zero, zero, zero, torch.ones_like(cos)], dim=1).view(-1, 3, 3)


def lifted(shift: Tensor) -> Tensor:
    """Return shifts (P, 3) from those in the floor plane (P, 2)."""
    return torch.nn.functional.pad(shift, (0, 1))


def turned(vectors: Tensor, turn: Tensor) -> Tensor:
    """Return vectors (P, 2), each turned by its cosine and sine (P, 2)."""
    return torch.view_as_real(torch.view_as_complex(vectors) * torch.view_as_complex(turn))


def align(source: Tensor, target: Tensor, weights: Tensor) -> PlanarMotion:
    """Return the motion that maps target points (P, N, 3) to source points (P, N, 3) with the least squared error.

    Heights are ignored: camera and robot stay level. Weights (P, N) are not negative; where they all vanish the
    motion is the identity.
    """
    share = weights / (weights.sum(-1, keepdim=True) + 1e-6)
    both = torch.cat([source[..., :2], target[..., :2]], dim=-1)
    mean = share[:, None] @ both
    both = both - mean
    # Row i, column j: how coordinate i of the source goes with coordinate j of the target.
    spread = both[..., :2].transpose(1, 2) @ (both[..., 2:] * share[..., None])
    (xx, xy), (yx, yy) = (row.unbind(-1) for row in spread.unbind(1))
    turn = torch.stack([xx + yy + 1e-4, yx - xy], dim=-1)
    turn = turn / torch.sqrt(turn.square().sum(-1, keepdim=True) + 1e-12)
    return PlanarMotion(mean[:, 0, :2] - turned(mean[:, 0, 2:].contiguous(), turn), turn)
