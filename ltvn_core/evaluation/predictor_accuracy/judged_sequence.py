"""The images of a recording, rectified for a predictor, with their true poses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.drive_part import WHOLE_DRIVE, DrivePart
from ltvn_core.data.recording.metadata import is_lens_known
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import RecordingError
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.training.drive_path import TrueViews, tilted_camera, true_views
from ltvn_core.types import Features, FrameId, Observation, Predictor, is_usable

_ENCODED_AT_ONCE = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedSequence:
    """N images of one recording."""

    path: Path
    observations: tuple[Observation, ...]
    """N images, rectified to the predictor's camera."""
    views: TrueViews | None
    """True poses of the images; None if truth is not used."""
    without_truth: int
    """Number of images left out because their true pose is unknown."""
    without_depth: int
    """Number of images left out because they have no depth and the predictor needs it."""
    skipped: int
    """Number of images left out because the sequence has more images than the maximum."""
    camera: CameraModel | None = None
    """The camera of the recording; None if it is the predictor's."""
    is_lens_known: bool = True
    """Whether the lens of that camera is known."""


def read_sequence(
    recording: Recording,
    predictor: Predictor,
    *,
    most: int,
    with_truth: bool,
    progress: Callable[[int], object],
    part: DrivePart = WHOLE_DRIVE,
) -> JudgedSequence:
    """Read at most `most` images of a recording, evenly spaced.

    Args:
        recording: Any recording.
        predictor: Determines the camera of the images, and whether they need depth.
        part: Part of the recording.
        most: Maximum number of images.
        with_truth: Leave out images without a true pose.
        progress: Called with the number of newly read images.

    Raises:
        RecordingError: Fewer than two images are left, or none has a true pose.
        ImageError: An image cannot be read.
    """
    frames = part.take(recording.frames)
    count = len(frames)
    chosen: list[int] = np.linspace(0, count - 1, min(count, most)).astype(int).tolist()
    seen: list[Observation] = []
    tilted: dict[FrameId, CameraModel] = {}
    for k in chosen:
        taken = recording.observation(frames[k])
        tilted[taken.step] = tilted_camera(taken, recording.meta.camera)
        seen.append(recorded_observation(taken, recording.meta.camera, predictor.camera))
        progress(1)
    usable = [each for each in seen if is_usable(each, predictor)]
    known = [each for each in usable if each.exact_pose is not None] if with_truth else usable
    if len(known) < 2:
        raise RecordingError(_too_few(recording.path, seen, usable))
    return JudgedSequence(
        path=recording.path,
        observations=tuple(known),
        views=true_views(known, [tilted[each.step] for each in known]) if with_truth else None,
        without_truth=len(usable) - len(known),
        without_depth=len(seen) - len(usable),
        skipped=count - len(chosen),
        camera=recording.meta.camera,
        is_lens_known=is_lens_known(recording.meta),
    )


def encode_sequence(
    predictor: Predictor, observations: Sequence[Observation], progress: Callable[[int], object]
) -> Features:
    """Return the features (N, F) of images; `progress` is called with the number of newly encoded ones."""
    parts = []
    for first in range(0, len(observations), _ENCODED_AT_ONCE):
        part = observations[first : first + _ENCODED_AT_ONCE]
        parts.append(predictor.encode(part))
        progress(len(part))
    return np.concatenate(parts)


def _too_few(path: Path, seen: Sequence[Observation], usable: Sequence[Observation]) -> str:
    if len(seen) < 2:
        return f"{path} holds {len(seen)} images; at least two are needed. Record or import a longer drive."
    if len(usable) < 2:
        return (
            f"{len(usable)} of the {len(seen)} images of {path} have depth, which the predictor needs; choose a "
            "predictor that needs no depth (--predictor)."
        )
    return (
        f"{path}: the true poses of its images are unknown, so answers cannot be checked. Import it with its ground "
        "truth, or judge the map alone with --without-truth."
    )
