"""Weighted rigid alignment of points in the floor plane (SE(2) Procrustes): closed form, batched, differentiable."""

from typing import NamedTuple

import torch
from torch import Tensor


class PlanarMotion(NamedTuple):
    """A rigid motion in the floor plane for each of P pairs: the pose of the target in the source's frame."""

    shift: Tensor
    """(P, 2) metres."""
    cos: Tensor
    """(P,)"""
    sin: Tensor
    """(P,)"""

    def apply(self, points: Tensor) -> Tensor:
        """Transform points (P, N, 3) from the target's frame to the source's."""
        cos, sin = self.cos[:, None], self.sin[:, None]
        x, y, z = points.unbind(-1)
        return torch.stack([cos * x - sin * y + self.shift[:, :1], sin * x + cos * y + self.shift[:, 1:], z], dim=-1)

    def inverse(self) -> "PlanarMotion":
        """Return the inverse motion: the pose of the source in the target's frame."""
        x, y = self.shift.unbind(-1)
        return PlanarMotion(
            torch.stack([-self.cos * x - self.sin * y, self.sin * x - self.cos * y], -1), self.cos, -self.sin
        )

    def detach(self) -> "PlanarMotion":
        """Return the same motion without gradient."""
        return PlanarMotion(self.shift.detach(), self.cos.detach(), self.sin.detach())

    def numbers(self) -> Tensor:
        """Return (P, 4): dx, dy, sin, cos."""
        return torch.stack([self.shift[:, 0], self.shift[:, 1], self.sin, self.cos], dim=-1)


def align(source: Tensor, target: Tensor, weights: Tensor) -> PlanarMotion:
    """Return the motion that maps target points (P, N, 3) to source points (P, N, 3) with the least squared error.

    Heights are ignored: camera and robot stay level. Weights (P, N) are not negative; where they all vanish the
    motion is the identity.
    """
    total = weights.sum(-1, keepdim=True) + 1e-6
    share = (weights / total)[..., None]
    mean_source = (share * source[..., :2]).sum(1)
    mean_target = (share * target[..., :2]).sum(1)
    a, b = target[..., :2] - mean_target[:, None], source[..., :2] - mean_source[:, None]
    cos = (share[..., 0] * (a * b).sum(-1)).sum(-1) + 1e-4
    sin = (share[..., 0] * (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])).sum(-1)
    norm = torch.sqrt(cos**2 + sin**2 + 1e-12)
    cos, sin = cos / norm, sin / norm
    turned = torch.stack(
        [cos * mean_target[:, 0] - sin * mean_target[:, 1], sin * mean_target[:, 0] + cos * mean_target[:, 1]], dim=-1
    )
    return PlanarMotion(mean_source - turned, cos, sin)
