"""Geometric verification: measures how well two depth images agree under a proposed motion.

Perceptual aliases have matching descriptors, but rarely matching geometry: transformed by the proposed motion, surfaces
of one image lie in the free space of the other. The pair head learns how to weigh the measures.
"""

import torch
from torch import Tensor, nn

from ltvn_core.network.alignment import PlanarMotion
from ltvn_core.network.architecture import DEPTH_STRIDE, NETWORK_CAMERA, PairArchitecture
from ltvn_core.network.encoder import pixel_rays

MEASURE_COUNT = 12
"""Numbers that `GeometricVerification` returns per pair."""

ROBOT_LOW_M = 0.06
ROBOT_HIGH_M = 0.7
"""Surfaces between these heights above the floor are obstacles for the robot."""

_NEAREST_M = 0.05
"""What is not at least so far ahead of a camera is not in its image."""
_FARTHEST_GAP_M = 0.6


class GeometricVerification(nn.Module):
    """Measures the agreement of two coarse depth images under a motion. Has no trainable weights.

    Written as few operations on large tensors, because a comparison of a few pairs takes as long as they are many.
    """

    turned_rays: Tensor
    """(3, 3 * G): the rays of the coarse grid, as the cosine, the sine and 1 of a rotation make them."""
    middle: Tensor
    """(2, 1): column and row of the middle of the coarse grid."""
    last: Tensor
    """(2, 1): column and row of its end, inside."""

    def __init__(self, size: PairArchitecture) -> None:
        super().__init__()
        self.rows, self.columns = size.depth_grid
        self.camera = NETWORK_CAMERA
        self.focal = self.camera.fx / DEPTH_STRIDE
        half = DEPTH_STRIDE // 2
        rays = pixel_rays(self.camera)[:, half::DEPTH_STRIDE, half::DEPTH_STRIDE].reshape(3, -1)
        zero = torch.zeros_like(rays[0])
        by_cos, by_sin = [rays[0], rays[1], zero], [-rays[1], rays[0], zero]
        turned = torch.stack([torch.cat(by_cos), torch.cat(by_sin), torch.cat([zero, zero, rays[2]])])
        ends = torch.tensor([[self.columns], [self.rows]], dtype=torch.float32)
        self.register_buffer("turned_rays", turned, persistent=False)
        self.register_buffer("middle", ends / 2, persistent=False)
        self.register_buffer("last", torch.nextafter(ends, torch.zeros(())), persistent=False)

    @torch.no_grad()
    def forward(self, source_depth: Tensor, target_depth: Tensor, motion: PlanarMotion) -> Tensor:
        """Return the measures (P, MEASURE_COUNT) for depths (P, G) and the motion from source to target."""
        still = PlanarMotion(
            torch.zeros_like(motion.shift), nn.functional.pad(torch.ones_like(motion.turn[:, :1]), (0, 1))
        )
        # The target seen from the source, the source seen from the target, and the source as it is.
        depth = torch.stack([target_depth, source_depth, source_depth])
        points = self.surfaces(depth, [motion, motion.inverse(), still])
        valid = depth > 0
        agreement = self.agreement(points[:2], valid[:2], torch.stack([source_depth, target_depth]))
        to_targets, to_sources = self.clearance(points[::2], valid[::2], motion.shift).unbind()
        ahead_m = motion.shift[:, 0]
        single = [self.room_ahead(source_depth, motion.shift), to_sources, to_targets, ahead_m.clamp(-4, 4)]
        return torch.cat([agreement[0], agreement[1], torch.stack(single, dim=-1)], dim=-1)

    def surfaces(self, depth: Tensor, motions: list[PlanarMotion]) -> Tensor:
        """Return points (S, P, 3, G) of depths (S, P, G) under S motions: forward, left and up."""
        turns = torch.stack([motion.turn for motion in motions])
        directions = nn.functional.pad(turns, (0, 1), value=1.0) @ self.turned_rays
        shifts = nn.functional.pad(torch.stack([motion.shift for motion in motions]), (0, 1))
        return torch.addcmul(shifts[..., None], directions.unflatten(-1, (3, -1)), depth[:, :, None])

    def agreement(self, points: Tensor, valid: Tensor, depth: Tensor) -> Tensor:
        """Return the shares (2, P, 4) of points (2, P, 3, G) that fit, are in free space, occluded, or out of view."""
        away = points[:, :, 0]
        pixel = torch.addcmul(self.middle, points[:, :, 1:], (-self.focal / away.clamp(min=_NEAREST_M))[:, :, None])
        within = torch.minimum(pixel.clamp(min=0), self.last)
        column, row = within.long().unbind(2)
        observed = torch.gather(depth, -1, row * self.columns + column)
        # What needed no clamping is in the image.
        inside = (within == pixel).all(2) & valid & (away > _NEAREST_M) & (observed > 0)
        # In units of a tolerance that grows with distance, as the errors of depth and of the motion do.
        excess = (observed - away) / (0.1 + 0.1 * away.clamp(min=0)) * inside
        counted = torch.stack([excess > 1, excess < -1, inside, valid]).to(depth.dtype).sum(-1)
        free, occluded, seen, whole = counted.unbind()
        shares = torch.stack([seen - free - occluded, free, occluded, whole - seen], dim=-1)
        return shares / whole[..., None].clamp(min=1)

    def room_ahead(self, depth: Tensor, shift: Tensor) -> Tensor:
        """Return by how many metres (P,) the source sees past the target's position, at the height of the camera."""
        ahead_m, left_m = shift.unbind(-1)
        pixel = self.columns / 2 - self.focal * left_m / ahead_m.clamp(min=_NEAREST_M)
        within = pixel.clamp(0, self.columns - 1)
        # Three rows around the horizon, because the camera's own height is where the target's camera would be.
        middle = depth.unflatten(-1, (self.rows, self.columns))[:, self.rows // 2 - 1 : self.rows // 2 + 2]
        nearest = torch.gather(middle, 2, within.long()[:, None, None].expand(-1, 3, 1))[..., 0].amin(-1)
        inside = (ahead_m > _NEAREST_M) & (pixel >= 0) & (pixel < self.columns)
        return torch.tanh(nearest - ahead_m).where(inside, -1.0)

    def clearance(self, points: Tensor, valid: Tensor, shift: Tensor) -> Tensor:
        """Return the metres (2, P), at most 0.6, between the line and the nearest obstacle of points (2, P, 3, G)."""
        floor, height = points[:, :, :2], points[:, :, 2] + self.camera.height_m
        solid = valid & (height > ROBOT_LOW_M) & (height < ROBOT_HIGH_M)
        line = shift / (shift.square().sum(-1, keepdim=True) + 1e-3)
        along = (line[:, None] @ floor).clamp(0, 1)
        # Squared, so that the root is taken once per pair and not once per point.
        squares = torch.addcmul(floor, along, shift[..., None], value=-1).square().sum(2)
        return squares.where(solid, _FARTHEST_GAP_M**2).amin(-1).clamp(max=_FARTHEST_GAP_M**2).sqrt()
