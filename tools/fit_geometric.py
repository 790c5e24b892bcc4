"""Fit the geometric predictor: `python -m tools.fit_geometric --scenes train-00 train-01 --recordings tour.rrd`.

Writes the visual words, the logistic regressions and the pairs that they were fitted on, beside the predictor. Images
come from simulated scenes, rendered at 320 x 240 by several cameras with noise, and from recordings with true poses.
Pairs of each drive and pairs across drives are compared in full, and a pose counts as right when it is near the truth.
The same seed gives the same files.
"""

import argparse
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.reader import Recording
from ltvn_core.geometry import relative
from ltvn_core.network.training_data.pose_sampling import ClusterSampling, cluster_poses
from ltvn_core.predictors.geometric_adaptation import (
    PAIRS_FILE,
    Comparisons,
    fit_logistic,
    is_right,
    write_comparisons,
)
from ltvn_core.predictors.geometric_evidence import (
    BOTH_DEPTHS,
    CALIBRATION_FILE,
    NO_DEPTH,
    ONE_DEPTH,
    Calibration,
    Evidence,
    shipped_calibration,
)
from ltvn_core.predictors.geometric_features import (
    WORDS_FILE,
    FeatureExtractor,
    ImageFeatures,
    ImageGrid,
    VisualWords,
    visual_words,
    votes,
)
from ltvn_core.predictors.geometric_verification import verify, waypoint
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Observation, Pose, Renderer
from tools.repeating_corridor import corridor_poses, repeating_corridor

WORDS = 64
DIMENSIONS = 32
CORRIDOR_WEIGHT = 0.03
"""A pair of a corridor counts so much; all corridors together then count about as much as one apartment."""
CAMERAS = (
    CameraModel.from_fov(320, 240, np.deg2rad(69.4), height_m=0.6),
    CameraModel.from_fov(320, 240, np.deg2rad(57.0), height_m=0.4, pitch_rad=np.deg2rad(5)),
    CameraModel.from_fov(320, 240, np.deg2rad(86.0), height_m=1.1, pitch_rad=np.deg2rad(-20)),
)
"""What simulated scenes are seen with, one after the other."""


@dataclass(frozen=True)
class Drive:
    """Images of one place with true poses (N, 3)."""

    name: str
    camera: CameraModel
    observations: Sequence[Observation]
    poses: Pose
    weight: float = 1.0


@dataclass(frozen=True)
class SeenDrive:
    """A drive with the features of its images."""

    camera: CameraModel
    grid: ImageGrid
    features: Sequence[ImageFeatures]
    poses: Pose
    weight: float


class Comparison(NamedTuple):
    """What a pair of images gave."""

    evidence: Evidence
    right: bool
    weight: float


def simulated_drive(scene_name: str, camera: CameraModel, rng: np.random.Generator, clusters: int) -> Drive:
    """Render clusters of neighbouring poses in an apartment."""
    scene = load_scene(scene_name)
    renderer = open_renderer(scene, camera)
    poses = cluster_poses(scene.clearance, rng, clusters, ClusterSampling()).reshape(-1, 3)
    return Drive(scene_name, camera, _observed(renderer, poses, camera, rng), poses)


def corridor_drive(number: int, camera: CameraModel, rng: np.random.Generator, clusters: int) -> Drive:
    """Render a corridor in which almost everything repeats."""
    corridor = repeating_corridor(rng)
    poses = corridor_poses(corridor, rng, clusters, size=8)
    return Drive(f"corridor-{number}", camera, _observed(corridor, poses, camera, rng), poses, CORRIDOR_WEIGHT)


def _observed(scene: Renderer, poses: Pose, camera: CameraModel, rng: np.random.Generator) -> list[Observation]:
    """Render what is seen from poses (N, 3), with the noise of a real sensor."""
    seen = [noisy(*scene.render(pose, camera), rng) for pose in poses]
    return [
        Observation(rgb=rgb, depth=depth, odometry=pose, stamp=float(k), step=k, exact_pose=pose)
        for k, ((rgb, depth), pose) in enumerate(zip(seen, poses, strict=True))
    ]


def noisy(
    rgb: NDArray[np.uint8], depth: NDArray[np.float32], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return an image with the exposure, noise and depth of a structured-light camera."""
    gain, grain = rng.uniform(0.75, 1.2), rng.uniform(1.0, 5.0)
    colours = np.clip(rgb * gain + rng.normal(0, grain, rgb.shape), 0, 255).astype(np.uint8)
    step = 0.0028 * depth**2  # One step of disparity.
    metres = depth + rng.normal(0, 1, depth.shape) * step * rng.uniform(0.3, 1.0)
    edges = np.abs(np.diff(depth, axis=1, append=depth[:, -1:])) > 0.05 * depth
    lost = edges | np.roll(edges, 1, axis=1) | (rng.random(depth.shape) < 0.02) | (depth > rng.uniform(4.5, 9.0))
    return colours, np.where(lost, 0, metres).astype(np.float32)


def recorded_drive(path: Path, first_share: float) -> Drive:
    """Read the first part of a recording with true poses."""
    recording = Recording.open(path)
    frames = list(recording.frames)
    kept = [recording.observation(frame) for frame in frames[: int(len(frames) * first_share)]]
    known = [each for each in kept if each.exact_pose is not None]
    return Drive(path.stem, recording.meta.camera, known, np.array([each.exact_pose for each in known]))


def fit_words(features: Sequence[ImageFeatures], rng: np.random.Generator) -> VisualWords:
    """Find typical descriptors of many images."""
    each = [f.descriptors[rng.permutation(len(f.descriptors))[:40]] for f in features]
    sample = np.concatenate(each).astype(np.float64)
    mean = sample.mean(0)
    _, axes = np.linalg.eigh(np.cov((sample - mean).T))
    axes = axes[:, ::-1][:, :DIMENSIONS]
    centres, _ = kmeans2((sample - mean) @ axes, WORDS, minit="++", rng=rng)
    return VisualWords(mean.astype(np.float32), axes.astype(np.float32), centres.astype(np.float32))


def drawn_pairs(drive: SeenDrive, rng: np.random.Generator, near: int, far: int) -> NDArray[np.intp]:
    """Return pairs (P, 2): near ones, far ones at random, and far ones whose key points match well."""
    poses = drive.poses
    first, second = np.triu_indices(len(poses), 1)
    gap = relative(poses[first], poses[second])
    close = (np.hypot(gap[:, 0], gap[:, 1]) < 2.0) & (np.abs(gap[:, 2]) < np.deg2rad(60))
    all_pairs = np.stack([first, second], axis=1)
    drawn = [all_pairs[rng.permutation(np.flatnonzero(part))[:count]] for part, count in ((close, near), (~close, far))]
    return np.concatenate([*drawn, _look_alikes(drive.features, drive.features, drawn[1])])


def _look_alikes(
    first: Sequence[ImageFeatures], second: Sequence[ImageFeatures], pairs: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Return the tenth of pairs (P, 2) whose strongest key points match best."""
    counted = np.array([votes(first[i].descriptors, second[j].descriptors) for i, j in pairs])
    return pairs[np.argsort(-counted, kind="stable")[: len(pairs) // 10]]


def compare(drive: SeenDrive, pairs: NDArray[np.intp]) -> Iterator[Comparison]:
    """Compare pairs of a drive in full; those without any pose give nothing to weigh."""
    for i, j in pairs:
        first, second = drive.features[i], drive.features[j]
        found = verify(first, second, drive.camera, drive.grid)
        if found is not None:
            measured = first.has_depth or second.has_depth
            truth = relative(drive.poses[i], drive.poses[j])
            right = is_right(waypoint(found.motion, first, second), truth, measured=measured)
            yield Comparison(found.evidence, right, drive.weight)


def compare_across(first: SeenDrive, second: SeenDrive, rng: np.random.Generator, count: int) -> Iterator[Comparison]:
    """Compare images of two places, of which no pair can be right."""
    drawn = np.stack([rng.integers(len(drive.features), size=10 * count) for drive in (first, second)], axis=1)
    for i, j in _look_alikes(first.features, second.features, drawn):
        found = verify(first.features[i], second.features[j], first.camera, first.grid)
        if found is not None:
            yield Comparison(found.evidence, right=False, weight=first.weight)


def see(drive: Drive) -> SeenDrive:
    """Find the features of all images of a drive."""
    extractor = FeatureExtractor(drive.camera)
    features = [extractor.extract(observation) for observation in drive.observations]
    return SeenDrive(drive.camera, extractor.grid, features, drive.poses, drive.weight)


def without_depth(drive: SeenDrive, *, every: int) -> SeenDrive:
    """Return the drive with the depth of each `every`-th image taken away."""
    features = [
        replace(each, depth=np.zeros_like(each.depth), grid_depth=np.zeros_like(each.grid_depth))
        if k % every == 0
        else each
        for k, each in enumerate(drive.features)
    ]
    return replace(drive, features=features)


def comparisons(drives: Sequence[SeenDrive], rng: np.random.Generator, pairs: int) -> Iterator[Comparison]:
    """Compare near pairs, three times as many far ones of each drive, and pairs of drives with one camera."""
    for k, drive in enumerate(drives):
        yield from compare(drive, drawn_pairs(drive, rng, pairs, 3 * pairs))
        for other in drives[k + 1 :]:
            if other.camera == drive.camera:
                yield from compare_across(drive, other, rng, pairs // 10)


def together(found: Iterable[Comparison]) -> Comparisons:
    """Return the pairs as a fit takes them."""
    evidence, right, weight = zip(*found, strict=True)
    return Comparisons(np.array(evidence, np.float64), np.array(right, bool), np.array(weight, np.float64))


def write_words(words: VisualWords) -> None:
    """Write the visual words beside the predictor."""
    np.savez_compressed(WORDS_FILE, **{name: part.astype(np.float16) for name, part in words._asdict().items()})
    visual_words.cache_clear()


def main() -> int:
    """Parse the command line, fit, and write both files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="*", default=[])
    parser.add_argument("--corridors", type=int, default=6, help="Corridors in which almost everything repeats.")
    parser.add_argument("--recordings", nargs="*", type=Path, default=[])
    parser.add_argument("--first-share", type=float, default=0.5, help="Use so much of each recording.")
    parser.add_argument("--clusters", type=int, default=20, help="Places of eight images in each scene.")
    parser.add_argument("--pairs", type=int, default=500, help="Near pairs of each drive, and as many far ones.")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    drives = [
        simulated_drive(scene, CAMERAS[k % len(CAMERAS)], rng, options.clusters)
        for k, scene in enumerate(options.scenes)
    ]
    drives += [corridor_drive(k, CAMERAS[k % len(CAMERAS)], rng, options.clusters) for k in range(options.corridors)]
    drives += [recorded_drive(path, options.first_share) for path in options.recordings]
    fit(drives, rng, options.pairs, shlex.join(["python", "-m", "tools.fit_geometric", *sys.argv[1:]]))
    sys.stdout.write(f"{WORDS_FILE.name}, {CALIBRATION_FILE.name} and {PAIRS_FILE.name} written\n")
    return 0


def fit(drives: Sequence[Drive], rng: np.random.Generator, pairs: int, command: str) -> None:
    """Fit words and regressions on drives, and write them, and the pairs."""
    seen = [see(drive) for drive in drives]
    write_words(fit_words([each for drive in seen for each in drive.features], rng))
    found = {
        BOTH_DEPTHS: together(comparisons(seen, rng, pairs)),
        ONE_DEPTH: together(comparisons([without_depth(drive, every=2) for drive in seen], rng, pairs // 2)),
        NO_DEPTH: together(comparisons([without_depth(drive, every=1) for drive in seen], rng, pairs // 2)),
    }
    write_comparisons(found)
    card = {
        "fitted_on": [drive.name for drive in drives],
        "pairs": {name: len(part.right) for name, part in found.items()},
        "right": {name: int(part.right.sum()) for name, part in found.items()},
        "command": command,
    }
    fitted = Calibration({name: fit_logistic(part) for name, part in found.items()}, card=card)
    CALIBRATION_FILE.write_text(fitted.text(), encoding="utf-8")
    shipped_calibration.cache_clear()


if __name__ == "__main__":
    sys.exit(main())
