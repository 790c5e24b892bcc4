"""Find the places of a map that look like a picture, with how likely the robot could drive there from it.

`python examples/16_find_a_picture_in_a_map.py` takes an image of `recordings/demo-drive.rrd` and asks
`recordings/demo-map.rrd`, which was built from another drive through the same apartment.
"""

from pathlib import Path

import numpy as np

import ltvn_core as ltvn

RECORDINGS = Path(__file__).parents[1] / "recordings"


def main() -> None:
    """Print the three nodes that look most like the picture."""
    drive = ltvn.Recording.open(RECORDINGS / "demo-drive.rrd")
    picture = drive.observation(drive.frames[len(drive.frames) // 2])
    known = ltvn.TopologicalMap.load(RECORDINGS / "demo-map.rrd", with_reserve=False)
    for node, likeness, (x, y, yaw) in known.find(picture, count=3):
        print(f"node {node}: r {likeness:.2f}, {np.hypot(x, y):.2f} m away, turned {np.degrees(yaw):+.0f} degrees")


if __name__ == "__main__":
    main()
