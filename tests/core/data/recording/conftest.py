"""The recording that most tests of files begin with."""

from pathlib import Path

import pytest

from tests.core.data.recording import example_recording


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished recording of ten images, to be read only."""
    path = tmp_path_factory.mktemp("whole") / "drive.rrd"
    example_recording.write(path)
    return path
