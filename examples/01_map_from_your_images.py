"""Make a map from images of your own robot, and save it.

Replace `my_frames` by a loop over your own data: colour, depth in metres, where odometry says the robot was, and when.
`ltvn replay map.rrd` then shows the map in the browser.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import ltvn_core as ltvn

DEMO = Path(__file__).parents[1] / "recordings" / "demo-drive.rrd"


def my_frames() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
    """Yield rgb (H, W, 3) uint8, depth (H, W) in metres, odometry (x, y, yaw) and seconds; here, of a demo drive."""
    drive = ltvn.Recording.open(DEMO)
    for frame in drive.frames[:60]:
        seen = drive.observation(frame)
        assert seen.depth is not None
        yield seen.rgb, seen.depth, seen.odometry, seen.stamp


def main(folder: Path) -> None:
    """Record the images, build the map, save it."""
    observations = [
        ltvn.preprocess_observation(rgb, depth, odometry, stamp=stamp, step=step)
        for step, (rgb, depth, odometry, stamp) in enumerate(my_frames())
    ]
    with ltvn.RecordingWriter(folder / "tour.rrd", scene="my-house") as writer:
        for observation in observations:
            writer.write_frame(observation)

    topological_map = ltvn.build_map(observations, scene="my-house")
    topological_map.save(folder / "map.rrd")
    graph = topological_map.graph
    print(f"{len(observations)} images became {len(graph.nodes)} nodes and {len(graph.edges)} edges: {folder}/map.rrd")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
