"""How networks are tested: each test draws the same random weights, whichever tests came before it."""

import pytest
import torch


@pytest.fixture(autouse=True)
def same_random_weights() -> None:
    torch.manual_seed(0)
