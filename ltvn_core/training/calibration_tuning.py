"""Fine-tuning of the geometric predictor: adapts its calibration to the images of one drive, in seconds.

Owns the sampling and the labels of the drive's pairs, the order of the steps, and the output: a complete calibration
with its card, or no file. `ltvn_core.predictors.geometric_adaptation` fits and compares calibrations.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ltvn_core.atomic_files import require_new_path, write_text_atomically
from ltvn_core.config import ROBUST
from ltvn_core.data.recording.drive_part import WHOLE_DRIVE, DrivePart
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import RecordingError
from ltvn_core.geometry import wrap_angle
from ltvn_core.predictors.geometric import GeometricPredictor, SurePose, drivable_share
from ltvn_core.predictors.geometric_adaptation import (
    OwnPairs,
    Rescaled,
    adapt,
    is_right,
    shipped_comparisons,
)
from ltvn_core.predictors.geometric_evidence import NO_EVIDENCE, Evidence
from ltvn_core.predictors.geometric_features import ImageFeatures, ImageGrid, image_grid
from ltvn_core.predictors.geometric_pose import ROOM_DEPTH_M
from ltvn_core.predictors.geometric_verification import verify, waypoint
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.training.drive_path import LIMITS, DrivePath, drive_path
from ltvn_core.types import Observation

MOST_CLOSE = 1000
"""Largest number of close pairs that are compared."""
MOST_LOOKING = 200
"""Largest number of images for which far images are searched and compared."""
CLOSE_M = 2.0
CLOSE_RAD = np.deg2rad(60)

_SAME_WAY_RAD = np.deg2rad(25)
_SAME_TURN_RAD = np.deg2rad(8)
_LEAST_SHIFT_M = 0.08
"""Least distance in metres of a pair that is used to measure the scale of guessed distances."""
_FEWEST_SHIFTS = 15
"""Least number of pairs needed to determine the scale of guessed distances."""
_ROOM_DEPTHS_M = (0.3, 20.0)


@dataclass(frozen=True, slots=True)
class FoundPose:
    """A pose between two images with its evidence, but without a certainty."""

    evidence: Evidence
    pose: SurePose
    """Pose of the target relative to the source."""


@dataclass(frozen=True, slots=True, eq=False)
class DrivePairs:
    """P compared pairs of a drive, with the pose found for each."""

    path: DrivePath
    features: Sequence[ImageFeatures]
    predictor: GeometricPredictor
    grid: ImageGrid
    source: NDArray[np.intp]
    """(P,) rows of the source images."""
    target: NDArray[np.intp]
    """(P,) rows of the target images."""
    found: Sequence[FoundPose | None]
    """Poses (P) found for the pairs, None without a pose; without depth, `epipolar_motion` guesses their distance."""
    far_pairs: int
    """Number of all far pairs of those images for which far images were searched."""

    def labelled(self, room_depth_m: float) -> OwnPairs:
        """Return the pairs with labels for a fit; distances without depth are guessed with the room depth."""
        truth = self.path.waypoints(self.source, self.target)
        far = self.path.far(self.source, self.target)
        known = self.path.known(self.source, self.target)
        right = np.zeros(len(self.source), bool)
        share = np.zeros(len(self.source))
        for k, found in enumerate(self.found):
            if found is not None:
                pose = found.pose if self._depths(k) else found.pose.scaled(room_depth_m / ROOM_DEPTH_M)
                x, y, turn = pose.waypoint
                if np.hypot(x, y) < ROBUST.building.connect_distance:
                    share[k] = drivable_share(self.features[self.source[k]], pose, self.predictor.camera, self.grid)
                right[k] = known[k] and is_right(pose.waypoint, truth[k], measured=self._depths(k) > 0)
                # In spite of drift, a pose that puts the target near is certainly wrong for a far pair.
                known[k] |= far[k] and not LIMITS.far(np.array([x, y, max(abs(turn), pose.turned_rad)]))
        return OwnPairs(
            source=self.source,
            target=self.target,
            images=len(self.features),
            near=self.path.near(self.source, self.target),
            far=far,
            known=known,
            right=right,
            depths=np.array([self._depths(k) for k in range(len(self.source))], np.intp),
            found=np.array([found is not None for found in self.found], bool),
            evidence=np.array([NO_EVIDENCE if found is None else found.evidence for found in self.found], np.float64),
            share=share,
            far_pairs=self.far_pairs,
        )

    def rescaled(self) -> Rescaled | None:
        """Return the pairs with the room depth that fits the drive; None if too few pairs without depth can measure
        it."""
        truth = self.path.waypoints(self.source, self.target)
        known = self.path.known(self.source, self.target)
        ratios = [
            np.log(np.hypot(*truth[k][:2]) / np.hypot(*found.pose.waypoint[:2]))
            for k, found in enumerate(self.found)
            if found is not None and known[k] and not self._depths(k) and _goes_the_same_way(found.pose, truth[k])
        ]
        if len(ratios) < _FEWEST_SHIFTS:
            return None
        depth = round(float(np.clip(ROOM_DEPTH_M * np.exp(np.median(ratios)), *_ROOM_DEPTHS_M)), 3)
        return Rescaled(self.labelled(depth), depth)

    def _depths(self, k: int) -> int:
        return self.features[self.source[k]].has_depth + self.features[self.target[k]].has_depth


def _goes_the_same_way(pose: SurePose, truth: NDArray[np.float64]) -> bool:
    if min(np.hypot(*pose.waypoint[:2]), np.hypot(*truth[:2])) < _LEAST_SHIFT_M:
        return False
    way = np.arctan2(pose.waypoint[1], pose.waypoint[0]) - np.arctan2(truth[1], truth[0])
    turn = pose.waypoint[2] - truth[2]
    return bool(abs(wrap_angle(way)) < _SAME_WAY_RAD and abs(wrap_angle(turn)) < _SAME_TURN_RAD)


def compare_drive(
    features: Sequence[ImageFeatures],
    path: DrivePath,
    predictor: GeometricPredictor,
    rng: np.random.Generator,
    progress: Callable[[int, int], object],
) -> DrivePairs:
    """Compare pairs of a drive in full: the close ones, and the far ones on the shortlist.

    `progress` is called with the number of compared pairs and the number of all pairs.
    """
    close = _close_pairs(path, rng)
    far, far_pairs = _far_pairs(path, features, predictor, rng)
    source, target = np.concatenate([close, far]).T
    grid = image_grid(predictor.camera)
    found: list[FoundPose | None] = []
    for i, j in zip(source, target, strict=True):
        found.append(_found_pose(features[i], features[j], predictor, grid))
        progress(len(found), len(source))
    return DrivePairs(
        path=path,
        features=features,
        predictor=predictor,
        grid=grid,
        source=source,
        target=target,
        found=found,
        far_pairs=far_pairs,
    )


def _close_pairs(path: DrivePath, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return up to `MOST_CLOSE` pairs (P, 2) in both directions that are not far apart, about half of them near."""
    count = len(path.poses)
    source, target = (rows.ravel() for rows in np.indices((count, count)))
    gap = path.waypoints(source, target)
    close = (np.hypot(gap[:, 0], gap[:, 1]) < CLOSE_M) & (np.abs(gap[:, 2]) < CLOSE_RAD) & (source != target)
    near = path.near(source, target) & (source != target)
    rest = close & path.known(source, target) & ~near
    halves = [rng.permutation(np.flatnonzero(part))[: MOST_CLOSE // 2] for part in (near, rest)]
    rows = np.sort(np.concatenate(halves))
    return np.stack([source[rows], target[rows]], axis=1)


def _far_pairs(
    path: DrivePath, features: Sequence[ImageFeatures], predictor: GeometricPredictor, rng: np.random.Generator
) -> tuple[NDArray[np.intp], int]:
    """Return the most similar far pairs (P, 2), and the number of all far pairs."""
    count = len(features)
    total = 0
    chosen: list[tuple[int, int]] = []
    for row in sorted(rng.permutation(count)[:MOST_LOOKING].tolist()):
        others: list[int] = np.flatnonzero(path.far(np.full(count, row), np.arange(count))).tolist()
        total += len(others)
        if others:
            best = predictor.shortlist(features[row], [features[other] for other in others])
            chosen += [(row, others[k]) for k in best]
    return np.array(chosen, np.intp).reshape(-1, 2), total


def _found_pose(
    source: ImageFeatures, target: ImageFeatures, predictor: GeometricPredictor, grid: ImageGrid
) -> FoundPose | None:
    """Return the pose of a pair, computed in the same order for both directions; None if no pose is supported."""
    first, second = sorted((source, target), key=lambda each: each.key)
    verified = verify(first, second, predictor.camera, grid)
    if verified is None:
        return None
    pose = SurePose(
        certainty=0.0,
        waypoint=waypoint(verified.motion, first, second),
        moved_m=float(np.linalg.norm(verified.motion.translation)),
        turned_rad=verified.motion.turned_rad,
    )
    return FoundPose(verified.evidence, pose if first is source else pose.inverse())


MOST_IMAGES = 400
"""Largest number of images of a drive that are used; in a longer drive, they are evenly spaced."""

StepProgress = Callable[[str, int, int], object]
"""Called with the current activity, the amount done and the total."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TunedCalibration:
    """A calibration fitted to a drive, with its metrics before and after."""

    weights: Path
    """File of the calibration, for --weights."""
    fingerprint: str
    parent: str
    """Fingerprint of the calibration from which tuning started."""
    changed: bool
    """Whether it differs from the parent; False if no candidate was better."""
    poses: str
    """Source of the poses that labelled the pairs: truth or odometry."""
    images: int
    pairs: int
    """Number of pairs that were compared."""
    near_pairs: int
    """Number of near pairs among the compared ones."""
    far_pairs: int
    """Number of all far pairs of those images for which far images were searched."""
    room_depth_m: float
    """Room depth in metres, which sets the scale of distances that are guessed without depth."""
    before: dict[str, float]
    """Shares of accepted poses with the parent: near and far pairs of the drive, and wrong poses of the package's
    pairs."""
    after: dict[str, float]
    """Shares of accepted poses with the adapted calibration, by cross-validation on sections of the drive."""


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
        predictor: Predictor for the recording's camera; its calibration is the parent.
        output: File of the new calibration.
        command: Command that reproduces the file, for its card.
        part: Part of the drive to learn from.
        seed: Seed for sampling the pairs.
        on_progress: Called after each image and pair.

    Raises:
        RecordingError: The drive is too short, has no poses, has no images that can be compared, or the output exists.
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
            "learn from. Are they blurred or dark, or does the recording name a wrong lens?"
        )
    parent = predictor.calibration
    adaptation = adapt(pairs.labelled(parent.room_depth_m), parent, shipped_comparisons(), pairs.rescaled())
    calibration = adaptation.calibration
    tuned = TunedCalibration(
        weights=output,
        fingerprint=calibration.fingerprint,
        parent=parent.fingerprint,
        changed=calibration.fingerprint != parent.fingerprint,
        poses="truth" if path.is_exact else "odometry",
        images=len(path.poses),
        pairs=len(pairs.source),
        near_pairs=int(np.count_nonzero(path.near(pairs.source, pairs.target))),
        far_pairs=pairs.far_pairs,
        room_depth_m=calibration.room_depth_m,
        before=asdict(adaptation.before),
        after=asdict(adaptation.after),
    )
    card = {name: value for name, value in asdict(tuned).items() if name not in ("weights", "room_depth_m")}
    card |= {"command": command, "part": str(part), "seed": seed, "ridge": adaptation.ridge}
    card |= {"caution": adaptation.caution, "parent_card": dict(parent.card)}
    write_text_atomically(output, replace(calibration, card=card).text())
    return tuned


def _observations(
    recording: Recording, predictor: GeometricPredictor, part: DrivePart, on_progress: StepProgress
) -> list[Observation]:
    """Read the images of a part for the predictor; if some have a true pose, read only those."""
    frames = part.take(recording.frames)
    rows = np.linspace(0, len(frames) - 1, min(len(frames), MOST_IMAGES)).astype(int)
    seen = []
    for row in rows:
        taken = recording.observation(frames[row])
        seen.append(recorded_observation(taken, recording.meta.camera, predictor.camera))
        on_progress("read", len(seen), len(rows))
    return [each for each in seen if each.exact_pose is not None] or seen
