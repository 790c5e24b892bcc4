"""The loss is Eq. 1, and its auxiliary terms find the true matches."""

import math

import numpy as np
import pytest
import torch

from ltvn_core.geometry import invert
from ltvn_core.network.loss import contrastive_loss, cross_entropy, pair_loss, place_loss, true_correspondence
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.pair_head import align
from ltvn_core.network.predictor import images_to_tensors
from tests.core.network.tiny_data import SMALL, tiny_shard


def test_the_loss_equals_equation_1_by_hand() -> None:
    logit = torch.tensor([0.3, -1.2])
    pose = torch.tensor([[1.0, 0.5, 0.1, 0.9], [3.0, 3.0, 0.0, 1.0]])
    waypoints = torch.tensor([[1.3, 0.1, 0.2], [0.0, 0.0, 0.0]])
    reachable = torch.tensor([1.0, 0.0])
    found = pair_loss(cross_entropy(logit, reachable), pose, reachable, waypoints, alpha=2.0, beta=0.5)
    first = -math.log(1 / (1 + math.exp(-0.3)))
    first += 2.0 * 0.5 + 0.5 * (abs(math.sin(0.2) - 0.1) + abs(math.cos(0.2) - 0.9))
    second = -math.log(1 - 1 / (1 + math.exp(1.2)))  # Its pose does not count: it is not reachable.
    assert found.item() == pytest.approx((first + second) / 2, rel=1e-5)


def test_the_position_error_is_not_squared() -> None:
    def loss(error: float) -> float:
        pose, waypoints = torch.tensor([[error, 0.0, 0.0, 1.0]]), torch.zeros(1, 3)
        return pair_loss(torch.zeros(1), pose, torch.ones(1), waypoints, alpha=1.0, beta=1.0).item()

    assert loss(4.0) == pytest.approx(4.0, abs=1e-4)
    assert loss(2.0) == pytest.approx(2.0, abs=1e-4)


def test_a_reachable_pair_is_told_from_as_many_as_there_were_negatives() -> None:
    logit, reachable = torch.tensor([2.0, 0.5, -1.0, 0.0]), torch.tensor([1.0, 1.0, 0.0, 0.0])
    found = contrastive_loss(logit, reachable, negatives=50)
    against = 25 * (math.exp(-1.0) + math.exp(0.0))
    by_hand = [-math.log(math.exp(score) / (math.exp(score) + against)) for score in (2.0, 0.5)]
    assert found.mean().item() == pytest.approx(sum(by_hand) / 2, rel=1e-5)
    assert torch.equal(found[2:], torch.zeros(2))
    assert contrastive_loss(logit + 7, reachable, negatives=50).tolist() == pytest.approx(found.tolist(), rel=1e-4)
    assert contrastive_loss(logit, torch.zeros(4), negatives=50).tolist() == [0.0] * 4


def test_alignment_finds_the_motion_that_made_the_points() -> None:
    generator = torch.Generator().manual_seed(0)
    target = torch.randn(5, 30, 3, generator=generator)
    angle, shift = torch.linspace(-3, 3, 5), torch.randn(5, 2, generator=generator)
    cos, sin = torch.cos(angle)[:, None], torch.sin(angle)[:, None]
    x = cos * target[..., 0] - sin * target[..., 1] + shift[:, :1]
    y = sin * target[..., 0] + cos * target[..., 1] + shift[:, 1:]
    motion = align(torch.stack([x, y, target[..., 2]], -1), target, torch.rand(5, 30, generator=generator))
    torch.testing.assert_close(motion.shift, shift, atol=1e-2, rtol=0)
    torch.testing.assert_close(motion.turn[:, 0], torch.cos(angle), atol=1e-3, rtol=0)
    waypoint = torch.cat([motion.shift, torch.atan2(motion.turn[:, 1:], motion.turn[:, :1])], dim=1)
    back = motion.inverse()
    expected = invert(waypoint.double().numpy())
    np.testing.assert_allclose(back.shift.numpy(), expected[:, :2], atol=1e-4)


def test_alignment_without_any_weight_is_no_motion() -> None:
    motion = align(torch.randn(1, 4, 3), torch.randn(1, 4, 3), torch.zeros(1, 4))
    torch.testing.assert_close(motion.numbers(), torch.tensor([[0.0, 0.0, 0.0, 1.0]]), atol=1e-3, rtol=0)


def test_an_image_corresponds_to_itself_and_to_nothing_in_another_scene() -> None:
    shard = tiny_shard()
    network = PairNetwork(SMALL).eval()
    with torch.no_grad():
        features = network.encode(*images_to_tensors(shard.rgb[:2], shard.depth_mm[:2] / np.float32(1000)))
    still = torch.zeros(2, 3)
    same = true_correspondence(features, features, still, torch.tensor([True, True]))
    assert len(same.pair) == 2 * SMALL.token_count
    assert torch.equal(same.source, same.target)
    other = true_correspondence(features, features, still, torch.tensor([False, False]))
    assert len(other.pair) == 0
    assert other.unmatched_source.all()
    assert other.unmatched_target.all()


def test_unknown_pairs_do_not_count_in_the_place_loss() -> None:
    logits = torch.tensor([[1.0, 9.0], [-9.0, -1.0]])
    labels = torch.tensor([[1.0, torch.nan], [torch.nan, 0.0]])
    assert place_loss(logits, labels).item() == pytest.approx(2 * math.log(1 + math.exp(-1.0)))
