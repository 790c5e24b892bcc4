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


class GeometricVerification(nn.Module):
    """Measures the agreement of two coarse depth images under a motion. Has no trainable weights."""

    rays: Tensor
    """(3, G) on the coarse grid."""

    def __init__(self, size: PairArchitecture) -> None:
        super().__init__()
        self.rows, self.columns = size.depth_grid
        self.camera = NETWORK_CAMERA
        half = DEPTH_STRIDE // 2
        rays = pixel_rays(self.camera)[:, half::DEPTH_STRIDE, half::DEPTH_STRIDE]
        self.register_buffer("rays", rays.reshape(3, -1), persistent=False)

    @torch.no_grad()
    def forward(self, source_depth: Tensor, target_depth: Tensor, motion: PlanarMotion) -> Tensor:
        """Return the measures (P, MEASURE_COUNT) for depths (P, G) and the motion from source to target."""
        source, target = source_depth[..., None] * self.rays.T, target_depth[..., None] * self.rays.T
        there, back = motion.apply(target), motion.inverse().apply(source)
        # Both images are measured in one pass, because small tensors cost as much as larger ones.
        valid = torch.stack([target_depth, source_depth]) > 0
        agreement = self.agreement(torch.stack([there, back]), valid, torch.stack([source_depth, target_depth]))
        clearance = self.clearance(torch.stack([there, source]), valid, motion)
        return torch.cat(
            [
                agreement[0],
                agreement[1],
                self.room_ahead(source_depth, motion),
                torch.stack([clearance[1], clearance[0], motion.shift[:, 0].clamp(-4, 4)], dim=-1),
            ],
            dim=-1,
        )

    def agreement(self, points: Tensor, valid: Tensor, depth: Tensor) -> Tensor:
        """Return the shares (2, P, 4) of points (2, P, G, 3) that fit, are in free space, occluded, or out of view."""
        pixel, inside = self.project(points)
        inside = inside & valid
        observed = torch.gather(depth, -1, pixel)
        inside = inside & (observed > 0)
        # In units of a tolerance that grows with distance, as the errors of depth and of the motion do.
        excess = (observed - points[..., 0]) / (0.1 + 0.1 * points[..., 0].clamp(min=0))
        fits = (excess.abs() <= 1) & inside
        shares = torch.stack([fits, (excess > 1) & inside, (excess < -1) & inside, ~inside & valid], dim=-2)
        return shares.sum(-1) / valid.sum(-1, keepdim=True).clamp(min=1)

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Return the coarse pixel (..., G) of each point (..., G, 3), and whether the point is in the image."""
        ahead = points[..., 0] > 0.05
        distance = torch.where(ahead, points[..., 0], torch.ones_like(points[..., 0]))
        focal = self.camera.fx / DEPTH_STRIDE
        column = torch.floor(self.columns / 2 - focal * points[..., 1] / distance)
        row = torch.floor(self.rows / 2 - focal * points[..., 2] / distance)
        inside = ahead & (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        pixel = row.clamp(0, self.rows - 1) * self.columns + column.clamp(0, self.columns - 1)
        return pixel.long(), inside

    def room_ahead(self, depth: Tensor, motion: PlanarMotion) -> Tensor:
        """Return by how many metres (P, 1) the source sees past the target's position, at the height of the camera."""
        eye = torch.cat([motion.shift, torch.zeros_like(motion.shift[:, :1])], dim=-1)[:, None]
        pixel, inside = self.project(eye)
        column = (pixel[:, 0] % self.columns)[:, None, None].expand(-1, 3, 1)
        # Three rows around the horizon, because the camera's own height is where the target's camera would be.
        middle = depth.reshape(-1, self.rows, self.columns)[:, self.rows // 2 - 1 : self.rows // 2 + 2]
        nearest = torch.gather(middle, 2, column)[..., 0].amin(-1)
        room = torch.tanh(nearest - motion.shift[:, 0])
        return torch.where(inside[:, 0], room, torch.full_like(room, -1))[:, None]

    def clearance(self, points: Tensor, valid: Tensor, motion: PlanarMotion) -> Tensor:
        """Return the metres (2, P), at most 0.6, between the line and the nearest obstacle of points (2, P, G, 3)."""
        height = points[..., 2] + self.camera.height_m
        solid = valid & (height > ROBOT_LOW_M) & (height < ROBOT_HIGH_M)
        line = motion.shift[:, None]
        along = (points[..., :2] * line).sum(-1) / ((line**2).sum(-1) + 1e-3)
        gap = points[..., :2] - along.clamp(0, 1)[..., None] * line
        # Squared, so that the root is taken once per pair and not once per point.
        squares = torch.where(solid, gap.square().sum(-1), torch.full_like(height, 0.36))
        return squares.amin(-1).clamp(max=0.36).sqrt()
