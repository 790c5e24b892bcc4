"""A few images with depth for contract tests: from the demo map, which comes with the toolkit."""

from typing import NamedTuple

from ltvn_core.errors import RecordingError
from ltvn_core.recording.demo_files import DEMO_MAP, demo_file
from ltvn_core.recording.metadata import RecordingMetadata
from ltvn_core.recording.reader import Recording
from ltvn_core.types import Observation


class SampleImages(NamedTuple):
    """Images and where they come from."""

    observations: tuple[Observation, ...]
    """In the order in which they were taken."""
    meta: RecordingMetadata


def sample_images(count: int) -> SampleImages:
    """Return the first images of the demo map. Raises RecordingError where the file is missing."""
    path = demo_file(DEMO_MAP)
    if path is None:
        raise RecordingError(f"{DEMO_MAP} is missing; install the toolkit anew: pip install ltvn (or -e .)")
    recording = Recording.open(path)
    return SampleImages(tuple(recording.observation(frame) for frame in recording.frames[:count]), recording.meta)
