"""The encoder: turns one RGB-D image into 108 tokens with 3D positions. Does not compare images."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.network.architecture import DEPTH_STRIDE, NETWORK_CAMERA, STRIDE, PairArchitecture
from ltvn_core.network.image_features import ImageFeatures

KEYPOINT_STEP = 2
"""The surface point of a token is chosen among every second pixel of its 8 x 8 cell."""

FARTHEST_DEPTH_M = 10.0
"""Upper limit to which depth is clipped, in metres."""


def conv_block(inputs: int, outputs: int, *, stride: int = 1, kernel: int = 3) -> nn.Sequential:
    """Return a convolution with batch normalisation and ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class ResidualBlock(nn.Module):
    """Two convolutions with a skip connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = conv_block(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, padding=1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, image: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        return functional.relu(image + self.second(self.first(image)))


class SelfAttentionBlock(nn.Module):
    """One pre-normalised self-attention layer over an image's tokens."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = nn.LayerNorm(channels)
        self.mix = nn.Linear(channels, 3 * channels)
        self.join = nn.Linear(channels, channels)
        self.feed = nn.Sequential(
            nn.LayerNorm(channels), nn.Linear(channels, 2 * channels), nn.ReLU(), nn.Linear(2 * channels, channels)
        )

    def forward(self, tokens: Tensor) -> Tensor:
        """Map (B, T, C) to the same shape."""
        batch, count, channels = tokens.shape
        parts = self.mix(self.norm(tokens)).reshape(batch, count, 3, self.heads, channels // self.heads)
        query, key, value = parts.permute(2, 0, 3, 1, 4).unbind(0)
        # Written out: the fused form's backward pass is several times slower on CPUs.
        share = ((query * query.shape[-1] ** -0.5) @ key.transpose(-1, -2)).softmax(-1)
        seen = share.to(value.dtype) @ value
        tokens = tokens + self.join(seen.transpose(1, 2).reshape(batch, count, channels))
        return tokens + self.feed(tokens)


class Encoder(nn.Module):
    """Convolutional encoder with one self-attention layer; maps RGB-D images to `ImageFeatures`."""

    rays: Tensor
    """(3, H, W): the point of each pixel at one metre of depth."""

    def __init__(self, size: PairArchitecture) -> None:
        super().__init__()
        self.size = size
        self.trunk = nn.Sequential(
            conv_block(6, size.stem, stride=2, kernel=5),
            conv_block(size.stem, size.middle, stride=2),
            ResidualBlock(size.middle),
            conv_block(size.middle, size.tokens, stride=2),
            ResidualBlock(size.tokens),
            ResidualBlock(size.tokens),
        )
        self.position = nn.Parameter(torch.randn(1, size.token_count, size.tokens) * 0.02)
        self.context = SelfAttentionBlock(size.tokens, size.heads)
        self.keypoint = nn.Linear(size.tokens, (STRIDE // KEYPOINT_STEP) ** 2)
        self.descriptor = nn.Linear(size.tokens, size.descriptor)
        self.value = nn.Linear(size.tokens, size.value)
        self.trust = nn.Linear(size.tokens, 2)
        self.place = nn.Sequential(nn.Linear(size.tokens * 6, 128), nn.ReLU(), nn.Linear(128, 2 * size.place))
        self.register_buffer("rays", pixel_rays(NETWORK_CAMERA), persistent=False)

    def forward(self, rgb: Tensor, depth: Tensor) -> ImageFeatures:
        """Encode rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres, 0 where missing."""
        depth = depth.clamp(max=FARTHEST_DEPTH_M)
        tokens = self.trunk(self.channels(rgb, depth))
        tokens = self.context(tokens.flatten(2).transpose(1, 2) + self.position)
        unmatched, saliency = self.trust(tokens).float().unbind(-1)
        query, key = self.places(tokens)
        half = DEPTH_STRIDE // 2
        return ImageFeatures(
            descriptors=functional.normalize(self.descriptor(tokens).float(), dim=-1),
            unmatched=unmatched,
            saliency=saliency,
            values=self.value(tokens),
            points=self.surface_points(self.keypoint(tokens).float(), depth),
            depth=depth[:, half::DEPTH_STRIDE, half::DEPTH_STRIDE].flatten(1),
            place_query=query,
            place_key=key,
        )

    def channels(self, rgb: Tensor, depth: Tensor) -> Tensor:
        """Return (B, 6, H, W): colour, depth, height and whether there is depth, each roughly in [-1, 1]."""
        has_depth = (depth > 0).to(depth.dtype)
        height = (depth * self.rays[2]).clamp(-1, 2)
        extra = torch.stack([depth * 0.4 - 1, height, has_depth], dim=1)
        image = torch.cat([rgb * 2 - 1, extra], dim=1)
        return image.contiguous(memory_format=torch.channels_last)

    def places(self, tokens: Tensor) -> tuple[Tensor, Tensor]:
        """Return the unit vectors (B, P) of the place score, as source and as target, pooled over six image columns."""
        rows, columns = self.size.grid
        strips = tokens.reshape(len(tokens), rows, 6, columns // 6, -1).mean(dim=(1, 3))
        query, key = self.place(strips.flatten(1)).float().chunk(2, dim=-1)
        return functional.normalize(query, dim=-1), functional.normalize(key, dim=-1)

    def surface_points(self, logits: Tensor, depth: Tensor) -> Tensor:
        """Return the surface points (B, T, 3) of tokens: weighted means of each cell's pixels that have depth.

        The weights are the softmax of learned logits (B, T, 16). A plain mean would lie between foreground and
        background at edges; learned weights can avoid that.
        """
        half = KEYPOINT_STEP // 2
        sparse = depth[:, None, half::KEYPOINT_STEP, half::KEYPOINT_STEP]
        rays = self.rays[None, :, half::KEYPOINT_STEP, half::KEYPOINT_STEP]
        cells = functional.unfold(sparse * rays, STRIDE // KEYPOINT_STEP, stride=STRIDE // KEYPOINT_STEP)
        cells = cells.reshape(len(depth), 3, -1, logits.shape[1])
        # Pixels without depth get no weight; a cell without any gives the point (0, 0, 0), which marks it as missing.
        missing = (cells[:, 0] <= 0).transpose(1, 2)
        weights = logits.masked_fill(missing, -1e4).softmax(-1)
        return torch.einsum("btk,bckt->btc", weights, cells)


def pixel_rays(camera: CameraModel) -> Tensor:
    """Return (3, H, W): x forward, y left, z up of every pixel's centre at one metre of depth."""
    left = (camera.cx - torch.arange(camera.width)) / camera.fx
    above = (camera.cy - torch.arange(camera.height)) / camera.fy
    shape = (camera.height, camera.width)
    return torch.stack([torch.ones(shape), left.expand(shape), above[:, None].expand(shape)])
