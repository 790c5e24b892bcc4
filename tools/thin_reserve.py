"""Write a map with a smaller reserve: `python -m tools.thin_reserve MAP.rrd SMALLER.rrd --keep-every 4`.

The reserve holds images that are no nodes and from which a map can grow. Neighbouring ones show almost the same, so the
demo map, which travels in the wheel, keeps only some. Nodes, edges and the images that stay are copied as they are.
"""

import argparse
import sys
from pathlib import Path

from ltvn_core.data.recording.map_file import load_map, save_map
from ltvn_core.graph.deltas import Cause, FramesReleased


def thin_reserve(path: Path, output: Path, keep_every: int) -> int:
    """Copy a map with every `keep_every`-th image of its reserve, and return how many images that drops."""
    loaded = load_map(path)
    graph = loaded.graph
    dropped = tuple(frame for place, frame in enumerate(sorted(graph.reserve)) if place % keep_every)
    graph.apply(FramesReleased(dropped, Cause.HAND))
    save_map(
        output,
        graph,
        loaded.observations.values(),
        scene=loaded.meta.scene,
        fingerprint=loaded.meta.fingerprint,
        config=loaded.meta.config,
        camera=loaded.meta.camera,
        scene_glb=loaded.scene_glb,
        origin=path,
    )
    return len(dropped)


def main() -> int:
    """Parse the command line and convert one map."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--keep-every", type=int, default=4)
    options = parser.parse_args()
    dropped = thin_reserve(options.map, options.output, options.keep_every)
    sys.stdout.write(f"{options.output}: {dropped} images of the reserve left out\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
