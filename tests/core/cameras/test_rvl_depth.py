"""Depth compressed by RVL comes back to the last bit, and damage is an error."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ltvn_core.cameras.encoded_images import decode_rvl
from ltvn_core.errors import DriveError
from tests.core.data.importing.rvl_encoder import encode_rvl

SPARSE = st.one_of(st.just(0), st.integers(0, 2**16 - 1))


@settings(max_examples=40, deadline=None)
@given(arrays(np.uint16, (6, 7), elements=SPARSE))
def test_what_was_compressed_comes_back(depth: np.ndarray) -> None:
    assert np.array_equal(decode_rvl(encode_rvl(depth), 7, 6, "depth"), depth)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=80), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_any_bytes_give_an_image_or_an_error(data: bytes, width: int, height: int) -> None:
    try:
        assert decode_rvl(data, width, height, "depth").shape == (height, width)
    except DriveError:
        return


def test_a_cut_image_is_an_error() -> None:
    whole = encode_rvl(np.arange(300, dtype=np.uint16).reshape(15, 20))

    with pytest.raises(DriveError, match="depth"):
        decode_rvl(whole[:40], 20, 15, "depth")
