"""Augmentation of training images, so that the network depends neither on exact colours nor on perfect depth."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class Augmentation:
    """Strengths of the augmentations (all values are ours); zero switches one off."""

    hue: float = 0.5
    """Share of scenes whose hues are rotated, by the same angle for all images of a scene."""
    gain: float = 0.25
    """Largest change of brightness per image, as a share."""
    ramp: float = 0.2
    """Largest change of brightness at the left and right border against the middle, as a share."""
    tint: float = 0.08
    """Largest shift of each colour channel, where colours range from 0 to 1."""
    contrast: float = 0.2
    """Largest change of contrast per image, as a share."""
    blur: float = 0.25
    """Share of images that are out of focus."""
    noise: float = 0.02
    """Standard deviation of pixel noise."""
    depth_scale: float = 0.01
    """Largest change of scale of the depth, per image, as a share."""
    depth_noise: float = 0.01
    """Standard deviation of the noise of the depth, as a share of the depth."""
    holes: float = 0.5
    """Share of images whose depth has a few patches removed."""


def augment(
    rgb: Tensor, depth: Tensor, scene: Tensor, strength: Augmentation, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Return augmented rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres, for images of scenes (B,)."""
    count = len(rgb)

    def spread(amount: float, channels: int) -> Tensor:
        return (torch.rand(count, channels, 1, 1, generator=generator, device=rgb.device) * 2 - 1) * amount

    rgb = turn_hues(rgb, scene, strength.hue, generator)
    mean = rgb.mean(dim=(2, 3), keepdim=True)
    rgb = (rgb - mean) * (1 + spread(strength.contrast, 1)) + mean
    across = torch.linspace(-1, 1, rgb.shape[3], device=rgb.device)
    light = 1 + spread(strength.gain, 1) + spread(strength.ramp, 1) * across
    rgb = rgb * light + spread(strength.tint, 3)
    rgb = defocus(rgb, strength.blur, generator)
    rgb = rgb + torch.randn(rgb.shape, generator=generator, device=rgb.device) * strength.noise
    depth = depth * (1 + spread(strength.depth_scale, 1)[:, 0])
    grain = torch.randn(depth.shape, generator=generator, device=rgb.device)
    depth = depth * (1 + grain * strength.depth_noise)
    return rgb.clamp(0, 1), depth * holes(depth, strength.holes, generator)


def turn_hues(rgb: Tensor, scene: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """Rotate the hues of a share of the scenes (B,) about the grey axis, each scene by its own angle."""
    number = int(scene.max()) + 1
    angle = (torch.rand(number, generator=generator, device=rgb.device) * 2 - 1) * torch.pi
    angle = angle * (torch.rand(number, generator=generator, device=rgb.device) < share)
    grey = torch.full((3, 3), 1 / 3, device=rgb.device)
    cross = torch.tensor([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]], device=rgb.device) / 3**0.5
    cos = torch.cos(angle)[:, None, None]
    sin = torch.sin(angle)[:, None, None]
    rotation = cos * torch.eye(3, device=rgb.device) + sin * cross + (1 - cos) * grey
    return torch.einsum("bij,bjhw->bihw", rotation[scene], rgb)


def defocus(rgb: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """Blur a share of the images by blending each with its 3 x 3 mean, with a random weight."""
    strength, chosen = torch.rand(2, len(rgb), 1, 1, 1, generator=generator, device=rgb.device)
    strength = strength * (chosen < share)
    soft = torch.nn.functional.avg_pool2d(rgb, 3, stride=1, padding=1, count_include_pad=False)
    return rgb + strength * (soft - rgb)


def holes(depth: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """Return masks (B, H, W): 0 in random patches of 12 x 12 pixels, which lose their depth, 1 elsewhere."""
    cells = (len(depth), 1, depth.shape[1] // 12, depth.shape[2] // 12)
    patches = torch.rand(cells, generator=generator, device=depth.device)
    hit = torch.rand(len(depth), 1, 1, 1, generator=generator, device=depth.device) < share
    mask = 1 - ((patches < 0.04) & hit).float()
    return torch.nn.functional.interpolate(mask, size=depth.shape[1:], mode="nearest")[:, 0]


def mirror(rgb: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
    """Return the images flipped left to right, which changes the sign of dy and dtheta of waypoints."""
    return rgb.flip(-1), depth.flip(-1)
