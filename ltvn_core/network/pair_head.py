"""The pair head: predicts reachability and waypoint from the features of two images.

Tokens are matched in both directions, and the matches are aligned by a rigid motion in the floor plane. Then tokens are
matched again, with a penalty for the residual of that alignment. The output layers get the matched mass, the residuals
and the agreement of the depth images under the motion. Perceptual aliases have matching descriptors but rarely matching
geometry: surfaces of one image then lie in the free space of the other.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ltvn_core.network.architecture import DEPTH_STRIDE, NETWORK_CAMERA, PairArchitecture
from ltvn_core.network.encoder import pixel_rays
from ltvn_core.network.image_features import ImageFeatures


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
    """Return rotation matrices (P, 3, 3) for points as row vectors, from cosines and sines (P, 2)."""
    cos = turn[:, :1]
    sin = turn[:, 1:]
    zero = torch.zeros_like(cos)
    return torch.cat([cos, sin, zero, -sin, cos, zero, zero, zero, torch.ones_like(cos)], dim=1).view(-1, 3, 3)


def lifted(shift: Tensor) -> Tensor:
    """Return shifts in the floor plane (P, 2) as 3D vectors (P, 3)."""
    return torch.nn.functional.pad(shift, (0, 1))


def turned(vectors: Tensor, turn: Tensor) -> Tensor:
    """Return vectors (P, 2), each rotated by its cosine and sine (P, 2)."""
    return torch.view_as_real(torch.view_as_complex(vectors) * torch.view_as_complex(turn))


def align(source: Tensor, target: Tensor, weights: Tensor) -> PlanarMotion:
    """Return the motion that maps target points (P, N, 3) to source points (P, N, 3) with the least squared error.

    Heights are ignored: camera and robot stay level. Weights (P, N) are not negative; if they are all zero, the motion
    is the identity.
    """
    share = weights / (weights.sum(-1, keepdim=True) + 1e-6)
    both = torch.cat([source[..., :2], target[..., :2]], dim=-1)
    mean = share[:, None] @ both
    both = both - mean
    # Row i, column j: covariance of coordinate i of the source with coordinate j of the target.
    spread = both[..., :2].transpose(1, 2) @ (both[..., 2:] * share[..., None])
    (xx, xy), (yx, yy) = (row.unbind(-1) for row in spread.unbind(1))
    turn = torch.stack([xx + yy + 1e-4, yx - xy], dim=-1)
    turn = turn / torch.sqrt(turn.square().sum(-1, keepdim=True) + 1e-12)
    return PlanarMotion(mean[:, 0, :2] - turned(mean[:, 0, 2:].contiguous(), turn), turn)


MEASURE_COUNT = 12
"""Numbers that `GeometricVerification` returns per pair."""

ROBOT_LOW_M = 0.06
ROBOT_HIGH_M = 0.7
"""Surfaces between these heights above the floor are obstacles for the robot."""

_NEAREST_M = 0.05
"""Points less than this ahead of a camera are not in its image."""
_FARTHEST_GAP_M = 0.6


class GeometricVerification(nn.Module):
    """Measures the agreement of two coarse depth images under a motion. Has no trainable weights.

    Uses few operations on large tensors, because the number of operations determines the time for a few pairs.
    """

    turned_rays: Tensor
    """(3, 3 * G) coefficients of cosine, sine and 1 that give the rotated rays of the coarse grid."""
    middle: Tensor
    """(2, 1) column and row of the middle of the coarse grid."""
    last: Tensor
    """(2, 1) largest column and row inside the coarse grid."""

    def __init__(self, size: PairArchitecture) -> None:
        super().__init__()
        self.rows, self.columns = size.depth_grid
        self.camera = NETWORK_CAMERA
        self.focal = self.camera.fx / DEPTH_STRIDE
        half = DEPTH_STRIDE // 2
        rays = pixel_rays(self.camera)[:, half::DEPTH_STRIDE, half::DEPTH_STRIDE].reshape(3, -1)
        zero = torch.zeros_like(rays[0])
        by_cos = [rays[0], rays[1], zero]
        by_sin = [-rays[1], rays[0], zero]
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
        # A pixel that needed no clamping is in the image.
        inside = (within == pixel).all(2) & valid & (away > _NEAREST_M) & (observed > 0)
        # In units of a tolerance that grows with distance, as the errors of depth and of the motion do.
        excess = (observed - away) / (0.1 + 0.1 * away.clamp(min=0)) * inside
        counted = torch.stack([excess > 1, excess < -1, inside, valid]).to(depth.dtype).sum(-1)
        free, occluded, seen, whole = counted.unbind()
        shares = torch.stack([seen - free - occluded, free, occluded, whole - seen], dim=-1)
        return shares / whole[..., None].clamp(min=1)

    def room_ahead(self, depth: Tensor, shift: Tensor) -> Tensor:
        """Return how far (P,) the source sees past the target at camera height: tanh of metres, -1 if out of view."""
        ahead_m, left_m = shift.unbind(-1)
        pixel = self.columns / 2 - self.focal * left_m / ahead_m.clamp(min=_NEAREST_M)
        within = pixel.clamp(0, self.columns - 1)
        # Three rows around the horizon, because the camera's own height is where the target's camera would be.
        middle = depth.unflatten(-1, (self.rows, self.columns))[:, self.rows // 2 - 1 : self.rows // 2 + 2]
        nearest = torch.gather(middle, 2, within.long()[:, None, None].expand(-1, 3, 1))[..., 0].amin(-1)
        inside = (ahead_m > _NEAREST_M) & (pixel >= 0) & (pixel < self.columns)
        return torch.tanh(nearest - ahead_m).where(inside, -1.0)

    def clearance(self, points: Tensor, valid: Tensor, shift: Tensor) -> Tensor:
        """Return the distances (2, P) in metres, at most 0.6, from the straight line to the nearest obstacle of points
        (2, P, 3, G)."""
        floor = points[:, :, :2]
        height = points[:, :, 2] + self.camera.height_m
        solid = valid & (height > ROBOT_LOW_M) & (height < ROBOT_HIGH_M)
        line = shift / (shift.square().sum(-1, keepdim=True) + 1e-3)
        along = (line[:, None] @ floor).clamp(0, 1)
        # Squared, so that the root is taken once per pair and not once per point.
        squares = torch.addcmul(floor, along, shift[..., None], value=-1).square().sum(2)
        return squares.where(solid, _FARTHEST_GAP_M**2).amin(-1).clamp(max=_FARTHEST_GAP_M**2).sqrt()


class TokenMatching(NamedTuple):
    """A soft assignment between T source and T target tokens, with "no match" on both sides.

    Scores of unit vectors are bounded, so their exponentials cannot overflow and no log-sum-exp is needed.
    """

    strength: Tensor
    """(P, T, T): exponential of the matching score of two tokens, at most 1."""
    row_total: Tensor
    """(P, T): sum over targets and "no match"."""
    column_total: Tensor
    """(P, T): sum over sources and "no match"."""
    row_unmatched: Tensor
    """(P, T): strength of "no match" for source tokens."""
    column_unmatched: Tensor
    """(P, T): strength of "no match" for target tokens."""

    def gather(self, known: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean point and value matched to each source token (P, T, 3 + V), and the matched mass that has
        depth (P, T).

        Each match is weighted by the probability that both tokens choose each other; `known` is the result of
        `what_matches_tell`.
        """
        # Dividing the two thin factors of the product by the totals saves two passes over all pairs of tokens.
        total = (self.strength * self.strength) @ (known / self.column_total[..., None]) / self.row_total[..., None]
        return total[..., 1:] / (total[..., :1] + 1e-3), total[..., 0]


class PairOutput(NamedTuple):
    """Predictions for P pairs."""

    logit: Tensor
    """(P,) logit of reachability."""
    pose: Tensor
    """(P, 4): dx, dy, sin, cos; sine and cosine are not normalised."""
    matching: TokenMatching | None = None
    """The first matching, by descriptors only; training supervises it. None in networks without matching."""


class PairSummary(NamedTuple):
    """Inputs of the output layers for P pairs, and the results of matching."""

    numbers: Tensor
    """(P, S) inputs of the output layers."""
    motion: PlanarMotion
    """Motion from source to target, by alignment."""
    matching: TokenMatching
    """First matching, by descriptors only."""


def summary_length(size: PairArchitecture) -> int:
    """Return S, the length of a pair's summary."""
    return 2 * size.hidden + 2 * 4 + 4 + MEASURE_COUNT


class PairHead(nn.Module):
    """Compares source and target features."""

    def __init__(self, size: PairArchitecture) -> None:
        super().__init__()
        self.sharpness = nn.Parameter(torch.tensor(12.0))
        self.closeness = nn.Parameter(torch.tensor(0.5))
        self.verify = GeometricVerification(size)
        inputs = 2 * size.value + 3 + 3 + 2
        self.token = nn.Sequential(
            nn.Linear(inputs, size.hidden), nn.ReLU(), nn.Linear(size.hidden, size.hidden), nn.ReLU()
        )
        self.attend = nn.Linear(size.hidden, 1)
        self.last = nn.Sequential(
            nn.Linear(summary_length(size), 128), nn.ReLU(), nn.Linear(128, 64), nn.ReLU(), nn.Linear(64, 6)
        )

    def forward(self, source: ImageFeatures, target: ImageFeatures) -> PairOutput:
        """Compare P sources with P targets."""
        return self.conclude(self.summarise(source, target))

    def summarise(self, source: ImageFeatures, target: ImageFeatures) -> PairSummary:
        """Match the tokens of P sources with those of P targets, and align the matches."""
        known = what_matches_tell(target)
        trust = token_trust(source)
        first = self.match(source, target)
        matched, mass = first.gather(known)
        rough = align(source.points, matched[..., :3], mass * trust)
        # No gradient through the rough motion, so that the second matching cannot improve at the cost of the first.
        second = self.match_in_space(first, source, target, rough.detach())
        matched_again, mass_again = second.gather(known)
        weights = mass_again * trust
        motion = align(source.points, matched_again[..., :3], weights)
        apart = motion.apply(matched_again[..., :3]) - source.points
        tokens = self.tokens(source, matched_again[..., 3:], apart, [mass, mass_again])
        both = torch.stack([weights, mass], dim=1)
        numbers = torch.cat(
            [
                self.pool(tokens),
                rough.numbers(),
                motion.numbers(),
                torch.stack([mass, mass_again], dim=1).mean(-1),
                (both @ torch.tanh(apart.norm(dim=-1))[..., None])[..., 0] / (both.sum(-1) + 1e-3),
                self.verify(source.depth, target.depth, motion.detach()),
            ],
            dim=-1,
        )
        return PairSummary(numbers, motion, first)

    def conclude(self, summary: PairSummary) -> PairOutput:
        """Apply the output layers to P summaries."""
        logit, gate, *_ = (numbers := self.last(summary.numbers).float()).unbind(-1)
        # A learned gate blends the aligned motion with a direct regression, for pairs with too few matches. The
        # offset of 1 makes training begin with mostly the alignment.
        trust = torch.sigmoid(gate + 1)[:, None]
        return PairOutput(logit, trust * summary.motion.numbers() + (1 - trust) * numbers[:, 2:], summary.matching)

    def match(self, source: ImageFeatures, target: ImageFeatures) -> TokenMatching:
        """Match descriptors; a token may also have no match."""
        scores = (source.descriptors * self.sharpness) @ target.descriptors.transpose(1, 2)
        # Subtracting the largest possible score keeps every exponential at most 1. In place, because a pass over all
        # pairs of tokens costs as much as their product.
        strength = scores.sub_(self.sharpness.abs()).exp_()
        declined = [torch.exp(side.unmatched - self.sharpness.abs()) for side in (source, target)]
        return normalize_matching(strength, *declined)

    def match_in_space(
        self, first: TokenMatching, source: ImageFeatures, target: ImageFeatures, motion: PlanarMotion
    ) -> TokenMatching:
        """Match again, with a penalty for tokens that are apart under the motion.

        The tolerance grows with distance, as a token covers more surface there.
        """
        there = motion.apply(target.points)
        # Squared distances by the binomial formula, as one product of five columns.
        strictness = (self.closeness.abs() / spread(source))[..., None]
        ones = torch.ones_like(strictness)
        here = torch.cat([2 * source.points, -source.points.square().sum(-1, keepdim=True), -ones], dim=-1)
        beyond = torch.cat([there, ones, there.square().sum(-1, keepdim=True)], dim=-1)
        near = torch.exp_((strictness * here) @ beyond.transpose(1, 2))
        return normalize_matching(near * first.strength, first.row_unmatched, first.column_unmatched)

    def tokens(self, source: ImageFeatures, values: Tensor, apart: Tensor, masses: Sequence[Tensor]) -> Tensor:
        """Return the tokens (P, T, H) after matching, from matched values (P, T, V), gaps (P, T, 3) and K masses."""
        sides = [source.values.float(), values, source.points / 5, torch.tanh(apart)]
        return self.token(torch.cat([*sides, *(mass[..., None] for mass in masses)], dim=-1))

    def pool(self, tokens: Tensor) -> Tensor:
        """Return (P, 2 H): attention-weighted mean and plain mean over tokens."""
        share = self.attend(tokens).float().softmax(1)
        return torch.cat([(share.transpose(1, 2) @ tokens)[:, 0], tokens.mean(1)], dim=-1)


def normalize_matching(strength: Tensor, row_unmatched: Tensor, column_unmatched: Tensor) -> TokenMatching:
    """Return the matching of strengths (P, T, T) normalised with the "no match" (P, T) of each side."""
    rows = strength.sum(2) + row_unmatched
    columns = strength.sum(1) + column_unmatched
    return TokenMatching(
        strength=strength,
        row_total=rows,
        column_total=columns,
        row_unmatched=row_unmatched,
        column_unmatched=column_unmatched,
    )


def what_matches_tell(target: ImageFeatures) -> Tensor:
    """Return (P, T, 1 + 3 + V) for target tokens: 1 if they have depth, else 0, then their points and values."""
    has_depth = (target.points[..., :1] > 0).to(target.points.dtype)
    # The mask is the first column, so that one product gives both the sums and their divisor.
    return torch.cat([has_depth, target.points, target.values.float() * has_depth], dim=-1)


def token_trust(source: ImageFeatures) -> Tensor:
    """Return the weights (P, T) of source tokens in the alignment."""
    has_depth = (source.points[..., 0] > 0).to(source.points.dtype)
    return torch.sigmoid(source.saliency) * has_depth / spread(source)


def spread(source: ImageFeatures) -> Tensor:
    """Return (P, T): the square of a token's uncertainty in metres, which grows with its distance."""
    return (0.2 + 0.1 * source.points[..., 0]).square()
