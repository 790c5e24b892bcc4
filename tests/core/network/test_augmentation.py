"""Augmentation changes how images look, never what they show where."""

import torch

from ltvn_core.network.optimization.augmentation import Augmentation, augment, mirror, turn_hues

NOTHING = Augmentation(0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


def random_images(count: int = 6) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(count, 3, 72, 96, generator=generator), torch.rand(count, 72, 96, generator=generator) * 4 + 0.5


def test_strength_zero_leaves_images_as_they_are() -> None:
    rgb, depth = random_images()
    same, same_depth = augment(rgb, depth, torch.zeros(6, dtype=torch.long), NOTHING, torch.Generator())
    torch.testing.assert_close(same, rgb)
    torch.testing.assert_close(same_depth, depth)


def test_changed_images_stay_in_range_and_the_same_seed_changes_them_the_same() -> None:
    rgb, depth = random_images()
    scene = torch.arange(6)
    one, two = (augment(rgb, depth, scene, Augmentation(), torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(one[0], two[0])
    assert torch.equal(one[1], two[1])
    assert one[0].min() >= 0
    assert one[0].max() <= 1
    assert not torch.equal(one[0], rgb)
    lost = one[1] == 0
    assert 0 < lost.float().mean() < 0.2
    assert ((one[1] / depth)[~lost] - 1).abs().max() < 0.1


def test_all_images_of_a_scene_get_the_same_hues_and_keep_their_brightness() -> None:
    rgb = random_images(1)[0].expand(6, -1, -1, -1)
    scene = torch.tensor([0, 0, 0, 1, 1, 1])
    turned = turn_hues(rgb, scene, 1.0, torch.Generator().manual_seed(0))
    assert torch.equal(turned[0], turned[2])
    assert not torch.allclose(turned[0], turned[3], atol=0.05)
    torch.testing.assert_close(turned.mean(1), rgb.mean(1))


def test_mirroring_twice_gives_the_image_back() -> None:
    rgb, depth = random_images()
    twice = mirror(*mirror(rgb, depth))
    assert torch.equal(twice[0], rgb)
    assert torch.equal(twice[1], depth)
