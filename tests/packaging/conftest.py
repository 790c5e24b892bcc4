"""The wheel, built once for all tests of packaging."""

from pathlib import Path

import pytest

from tests.packaging.environments import build_wheel


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of what git tracks here."""
    return build_wheel(tmp_path_factory.mktemp("wheel"))
