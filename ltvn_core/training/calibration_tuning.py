"""Fine-tuning of the geometric predictor: its calibration gets to know the images of one drive, in seconds.

Owns the order of the parts and what is on disk afterwards: the calibration with its card, whole, or nothing. Which
weights are better is decided in `ltvn_core.predictors.geometric_adaptation`.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.atomic_files import require_new_path, write_text_atomically
from ltvn_core.errors import RecordingError
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.geometric_adaptation import Adaptation, adapt, shipped_comparisons
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.recording.drive_part import WHOLE_DRIVE, DrivePart
from ltvn_core.recording.reader import Recording
from ltvn_core.training.calibration_pairs import DrivePairs, compare_drive
from ltvn_core.training.drive_path import DrivePath, drive_path
from ltvn_core.types import Observation

MOST_IMAGES = 400
"""Of a longer drive so many images are taken, evenly spaced."""

StepProgress = Callable[[str, int, int], object]
"""Takes what is being done, how much of it is done, and how much there is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TunedCalibration:
    """A calibration that learned from a drive, and figures before and after."""

    weights: Path
    """The file to name with --weights."""
    fingerprint: str
    parent: str
    """Fingerprint of the calibration it started from."""
    changed: bool
    """False where nothing was better than the parent, so that its numbers stay."""
    poses: str
    """By which the pairs were labelled: truth or odometry."""
    images: int
    pairs: int
    """Pairs that were compared,"""
    near_pairs: int
    """the near ones of them,"""
    far_pairs: int
    """and all far pairs of the images that looked for others."""
    room_depth_m: float
    """What distances are guessed by without depth."""
    before: dict[str, float]
    """By the parent: shares of near and far pairs that are accepted, and of wrong poses among the package's pairs."""
    after: dict[str, float]
    """The same by calibrations fitted without the stretch of the drive that they are judged on."""


def tune_calibration(
    recording: Recording,
    predictor: GeometricPredictor,
    output: Path,
    *,
    command: str,
    part: DrivePart = WHOLE_DRIVE,
    seed: int = 0,
    on_progress: StepProgress,
) -> TunedCalibration:
    """Adapt a predictor's calibration to a drive and write it to a new file.

    Args:
        recording: The drive, with true poses or odometry.
        predictor: Made for the recording's camera; its calibration is the parent.
        output: The calibration to write.
        command: What makes it again, for the card.
        part: Learn from this part of the drive alone.
        seed: Draws the pairs.
        on_progress: Hears of each image and pair.

    Raises:
        RecordingError: The drive is too short, nobody knows where it went, its images show nothing that can be
            compared, or the output exists.
        ImageError: An image cannot be read.
    """
    require_new_path(output)
    seen = _observations(recording, predictor, part, on_progress)
    path = drive_path(seen, recording.path.name, predictor.camera)
    features = []
    for observation in seen:
        features.append(predictor.encode([observation])[0, 0])
        on_progress("encode", len(features), len(seen))
    pairs = compare_drive(
        features,
        path,
        predictor,
        np.random.default_rng(seed),
        lambda done, total: on_progress("compare", done, total),
    )
    if not any(pairs.found):
        raise RecordingError(
            f"{recording.path}: no two of its {len(seen)} images have key points in common, so there is nothing to "
            "learn from. Are they blurred or dark, or is the lens another one than the recording says?"
        )
    parent = predictor.calibration
    adaptation = adapt(pairs.labelled(parent.room_depth_m), parent, shipped_comparisons(), pairs.rescaled())
    tuned = _summary(adaptation, pairs, path, output, parent.fingerprint)
    card = _card(tuned, adaptation, command=command, part=part, seed=seed) | {"parent_card": dict(parent.card)}
    write_text_atomically(output, replace(adaptation.calibration, card=card).text())
    return tuned


def _observations(
    recording: Recording, predictor: GeometricPredictor, part: DrivePart, on_progress: StepProgress
) -> list[Observation]:
    """Read the images of a part, as the predictor takes them; where some have a true pose, those alone."""
    frames = part.take(recording.frames)
    rows = np.linspace(0, len(frames) - 1, min(len(frames), MOST_IMAGES)).astype(int)
    seen = []
    for row in rows:
        taken = recording.observation(frames[row])
        seen.append(recorded_observation(taken, recording.meta.camera, predictor.camera))
        on_progress("read", len(seen), len(rows))
    return [each for each in seen if each.exact_pose is not None] or seen


def _summary(adaptation: Adaptation, pairs: DrivePairs, path: DrivePath, output: Path, parent: str) -> TunedCalibration:
    calibration = adaptation.calibration
    return TunedCalibration(
        weights=output,
        fingerprint=calibration.fingerprint,
        parent=parent,
        changed=calibration.fingerprint != parent,
        poses="truth" if path.is_exact else "odometry",
        images=len(path.poses),
        pairs=len(pairs.source),
        near_pairs=int(np.count_nonzero(path.near(pairs.source, pairs.target))),
        far_pairs=pairs.far_pairs,
        room_depth_m=calibration.room_depth_m,
        before=asdict(adaptation.before),
        after=asdict(adaptation.after),
    )


def _card(
    tuned: TunedCalibration, adaptation: Adaptation, *, command: str, part: DrivePart, seed: int
) -> dict[str, Any]:
    """Return what the file says of how it was made, as JSON has it."""
    told = {name: value for name, value in asdict(tuned).items() if name not in ("weights", "room_depth_m")}
    return told | {
        "command": command,
        "part": str(part),
        "seed": seed,
        "ridge": adaptation.ridge,
        "caution": adaptation.caution,
    }
