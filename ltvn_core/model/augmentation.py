"""Random changes of training images, so that the network trusts neither exact colours nor perfect depth.

Owns the changes. Everything is drawn from the generator that comes in.
"""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class Augmentation:
    """Strengths of the changes (all ours); zero switches one off."""

    gain: float = 0.25
    """Brightness is scaled by up to this share, per image."""
    tint: float = 0.08
    """Each colour channel is shifted by up to this, of a range of 1."""
    contrast: float = 0.2
    """Contrast is scaled by up to this share."""
    noise: float = 0.02
    """Standard deviation of pixel noise."""
    depth_noise: float = 0.01
    """Standard deviation of depth as a share of it."""
    holes: float = 0.5
    """Share of images whose depth loses a few patches."""


def augment(rgb: Tensor, depth: Tensor, strength: Augmentation, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Change rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres; return the same shapes."""
    count = len(rgb)

    def spread(amount: float, channels: int) -> Tensor:
        return (torch.rand(count, channels, 1, 1, generator=generator) * 2 - 1) * amount

    mean = rgb.mean(dim=(2, 3), keepdim=True)
    rgb = (rgb - mean) * (1 + spread(strength.contrast, 1)) + mean
    rgb = rgb * (1 + spread(strength.gain, 1)) + spread(strength.tint, 3)
    rgb = rgb + torch.randn(rgb.shape, generator=generator) * strength.noise
    depth = depth * (1 + torch.randn(depth.shape, generator=generator) * strength.depth_noise)
    return rgb.clamp(0, 1), depth * holes(depth, strength.holes, generator)


def holes(depth: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """Return (B, H, W): 0 in patches of 12 x 12 pixels without return, 1 elsewhere."""
    patches = torch.rand(len(depth), 1, depth.shape[1] // 12, depth.shape[2] // 12, generator=generator)
    hit = torch.rand(len(depth), 1, 1, 1, generator=generator) < share
    mask = 1 - ((patches < 0.04) & hit).float()
    return torch.nn.functional.interpolate(mask, size=depth.shape[1:], mode="nearest")[:, 0]


def mirror(rgb: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
    """Return the images as seen in a mirror; left becomes right, so dy and dtheta of waypoints change sign."""
    return rgb.flip(-1), depth.flip(-1)
