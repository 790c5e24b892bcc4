"""Write a predictor of your own: anything that compares two observations can build maps and navigate.

This one knows a place again by its colours and believes odometry for the way there: good enough to see how the parts
fit together, and a baseline that any network should beat.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import ltvn_core as ltvn

DEMO = Path(__file__).parents[1] / "recordings" / "demo-drive.rrd"
BINS = 8


class ColourPredictor:
    """Implements `ltvn_core.Predictor`."""

    fingerprint = "colour-histogram-1"
    """Maps remember it; change it whenever the numbers change."""
    camera = ltvn.LOCOBOT.camera
    """The camera whose images it compares; those of other cameras are rectified to it."""

    def encode(self, observations: Sequence[ltvn.Observation]) -> np.ndarray:
        """Return (N, 3 + 3 * BINS): odometry and a histogram of each colour, one row per image."""
        return np.array([np.concatenate([seen.odometry, self._histogram(seen.rgb)]) for seen in observations])

    def predict(self, sources: np.ndarray, targets: np.ndarray) -> ltvn.Prediction:
        """Compare sources (N, F) or (1, F) with targets (N, F)."""
        sources = np.broadcast_to(sources, targets.shape)
        waypoints = ltvn.relative(sources[:, :3], targets[:, :3])
        likeness = np.minimum(sources[:, 3:], targets[:, 3:]).sum(axis=1)
        near = np.exp(-0.2 * (np.hypot(waypoints[:, 0], waypoints[:, 1]) + np.abs(waypoints[:, 2])))
        return ltvn.Prediction(reachability=likeness * near, waypoints=waypoints)

    def _histogram(self, rgb: np.ndarray) -> np.ndarray:
        counts = [np.histogram(rgb[..., colour], BINS, (0, 256))[0] for colour in range(3)]
        return np.concatenate(counts) / rgb.size


def main() -> None:
    """Build a map of the demo drive with it."""
    recording = ltvn.Recording.open(DEMO)
    observations = [recording.observation(frame) for frame in recording.frames[:200]]
    graph = ltvn.build_map(observations, predictor=ColourPredictor(), scene="demo").graph
    print(f"{len(observations)} images became {len(graph.nodes)} nodes and {len(graph.edges)} edges")


if __name__ == "__main__":
    main()
