"""Whatever a camera delivers comes in as 96 x 72 or is refused with a message that says what to mend."""

import numpy as np
import pytest

from ltvn_core.errors import ImageError
from ltvn_core.preprocessing import preprocess_image, preprocess_observation
from ltvn_core.types import Observation


def rgb(height: int = 72, width: int = 96) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def depth(height: int = 72, width: int = 96, metres: float = 2.0) -> np.ndarray:
    return np.full((height, width), metres, np.float32)


def taken(image: np.ndarray, metres: np.ndarray, odometry: object = (0, 0, 0), stamp: float = 0.0) -> Observation:
    return preprocess_observation(image, metres, np.array(odometry, float), stamp=stamp, step=7, source="front camera")


def test_a_good_image_comes_in_unchanged() -> None:
    image, metres = rgb(), depth()
    seen = taken(image, metres)
    assert np.array_equal(seen.rgb, image)
    assert np.array_equal(seen.require_depth("the test"), metres)
    assert seen.step == 7


@pytest.mark.parametrize("size", [(144, 192), (480, 640), (36, 48), (50, 200)])
def test_any_size_becomes_the_size_of_the_method(size: tuple[int, int]) -> None:
    seen = taken(rgb(*size), depth(*size))
    assert seen.rgb.shape == (72, 96, 3)
    assert seen.require_depth("the test").shape == (72, 96)
    assert seen.require_depth("the test").dtype == np.float32


def test_resized_depth_never_invents_a_distance_between_near_and_far() -> None:
    metres = depth(144, 192, 1.0)
    metres[:, 96:] = 5.0
    metres[:10] = 0.0
    assert set(np.unique(taken(rgb(144, 192), metres).require_depth("the test"))) <= {0.0, 1.0, 5.0}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -0.5], ids=["NaN", "infinite", "minus infinite", "negative"])
def test_one_bad_depth_pixel_is_refused(bad: float) -> None:
    metres = depth()
    metres[3, 4] = bad
    with pytest.raises(ImageError, match="front camera: depth holds NaN, infinite or negative"):
        taken(rgb(), metres)


@pytest.mark.parametrize("nothing", [0.0, np.nan], ids=["zero", "NaN"])
def test_an_image_without_any_depth_comes_in_and_is_marked(nothing: float) -> None:
    seen = taken(rgb(), depth(metres=nothing))
    assert not seen.has_depth
    assert not seen.require_depth("the test").any()
    assert taken(rgb(), depth()).has_depth


def test_depth_in_whole_millimetres_is_refused_with_the_cure() -> None:
    with pytest.raises(ImageError, match="divide millimetres by 1000"):
        taken(rgb(), np.full((72, 96), 2000, np.uint16))


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((72, 96), np.uint8),
        np.zeros((72, 96, 4), np.uint8),
        np.zeros((72, 96, 3), np.float32),
        np.zeros((0, 96, 3), np.uint8),
    ],
    ids=["grey", "with alpha", "floating point", "empty"],
)
def test_images_of_another_kind_are_refused(image: np.ndarray) -> None:
    with pytest.raises(ImageError, match="expected an RGB image"):
        taken(image, depth())
    with pytest.raises(ImageError, match=r"holiday\.png: expected an RGB image"):
        preprocess_image(image, "holiday.png")


def test_image_and_depth_of_different_sizes_are_refused() -> None:
    with pytest.raises(ImageError, match="same size"):
        taken(rgb(144, 192), depth())


@pytest.mark.parametrize("odometry", [(0, np.nan, 0), (0, 0), (np.inf, 0, 0)])
def test_a_pose_that_is_not_three_finite_numbers_is_refused(odometry: tuple[float, ...]) -> None:
    with pytest.raises(ImageError, match="three finite numbers"):
        taken(rgb(), depth(), odometry)


def test_a_stamp_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ImageError, match="finite stamp"):
        taken(rgb(), depth(), stamp=np.nan)


def test_an_uploaded_image_needs_no_depth() -> None:
    assert preprocess_image(rgb(300, 400), "upload").shape == (72, 96, 3)
