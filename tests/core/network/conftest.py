"""How networks are tested: each test draws the same random weights, whichever tests came before it."""

import pytest


@pytest.fixture(autouse=True)
def same_random_weights() -> None:
    import torch  # Only here, as pytest reads this file also where PyTorch is not installed.

    torch.manual_seed(0)
