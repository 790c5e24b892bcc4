"""Whatever a camera delivers comes in as 96 x 72 or is refused with a message that says what to mend."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
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


def test_an_uploaded_image_needs_no_depth() -> None:
    assert preprocess_image(rgb(300, 400), "upload").shape == (72, 96, 3)


def image(**changed: object) -> object:
    good = {
        "rgb": np.zeros((72, 96, 3), np.uint8),
        "depth": np.ones((72, 96), np.float32),
        "odometry": np.zeros(3),
        "stamp": 0.0,
        "step": 0,
    }
    return preprocess_observation(**{**good, **changed})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"rgb": [[1, 2], [3]]}, "rows differ in length"),
        ({"depth": [[1.0, 2.0], [3.0]]}, "rows differ in length"),
        ({"odometry": [[1, 2], 3]}, "three finite numbers"),
        ({"odometry": ["a", "b", "c"]}, "three finite numbers"),
        ({"odometry": None}, "three finite numbers"),
        ({"odometry": (0, np.nan, 0)}, "three finite numbers"),
        ({"odometry": (0, 0)}, "three finite numbers"),
        ({"odometry": [10**400, 0, 0]}, "three finite numbers"),
        ({"odometry": [1e300, 0, 0]}, "three finite numbers"),
        ({"stamp": "now"}, "finite stamp"),
        ({"stamp": None}, "finite stamp"),
        ({"stamp": np.nan}, "finite stamp"),
        ({"stamp": 10**400}, "finite stamp"),
        ({"stamp": 1.7e18}, "divide nanoseconds"),
        ({"step": 10**30}, "at most 2\\^53"),
        ({"step": 1.5}, "whole number"),
        ({"step": float("nan")}, "whole number"),
        ({"depth": np.full((72, 96), 1e300)}, "infinite"),
        ({"depth": np.full((72, 96), 2100.0)}, "divide millimetres by 1000"),
        ({"depth": np.full((72, 96), 2000, np.uint16)}, "divide millimetres by 1000"),
    ],
)
def test_what_a_robot_of_ones_own_gets_wrong_is_said_at_the_door(changed: dict[str, object], said: str) -> None:
    with pytest.raises(ImageError, match=said):
        image(**changed)


@pytest.mark.parametrize("step", [2**31, 2**40, 2**53])
def test_large_steps_are_kept_exactly(tmp_path: Path, step: int) -> None:
    seen = image(step=np.int64(step))
    with RecordingWriter(tmp_path / "late.rrd", scene="", config={}, fingerprint="") as writer:
        writer.write_frame(seen)  # type: ignore[arg-type]
    (frame,) = Recording.open(tmp_path / "late.rrd").frames
    assert frame == step
