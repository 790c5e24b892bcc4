"""Import drives in a format of your own: a function from a folder to a table of files, here for KITTI's odometry.

`python examples/17_import_your_own_format.py SEQUENCE kitti.rrd` imports a sequence. In a package, the entry
`kitti = "my_package:KITTI"` of the group `ltvn.readers` makes `ltvn import SEQUENCE` recognise it.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing import drive_import, file_drive, pose_track, raw_frame, stamped_lists

IMAGES, TIMES, POSES, LENSES = "image_2", "times.txt", "poses.txt", "calib.txt"


def kitti(folder: Path, options: raw_frame.ReadOptions) -> file_drive.FileDrive:
    """Return the table of a sequence: an image, its time, its lens and its pose in each row."""
    times = [float(words[0]) for _, _, words in stamped_lists.list_lines(folder / TIMES, "list of times")]
    rows = [
        [float(word) for word in words] for _, _, words in stamped_lists.list_lines(folder / POSES, "list of poses")
    ]
    lenses = {words[0]: words[1:] for _, _, words in stamped_lists.list_lines(folder / LENSES, "list of lenses")}
    projection = np.array(lenses["P2:"], np.float64).reshape(3, 4)
    frames = [
        file_drive.ListedFrame(
            colour=f"{IMAGES}/{k:06d}.png", moment=raw_frame.FrameMoment(time), lens=partial(camera, projection)
        )
        for k, time in enumerate(times)
    ]
    return file_drive.FileDrive(
        format="kitti",
        folder=folder,
        frames=frames,
        streams=file_drive.listed_streams(frames, IMAGES, options),
        poses=pose_track.picture_poses([np.vstack([np.reshape(row, (3, 4)), [0, 0, 0, 1]]) for row in rows], POSES),
    )


def camera(projection: np.ndarray, width: int, height: int) -> CameraModel:
    """Return the camera of a projection (3, 4) in pixels."""
    (fx, _, cx, _), (_, fy, cy, _), _ = projection.tolist()
    return CameraModel(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)


KITTI = file_drive.FolderFormat(
    lambda path: all((path / name).exists() for name in (IMAGES, TIMES, POSES, LENSES)), kitti
)

if __name__ == "__main__":
    source, output = map(Path, sys.argv[1:])
    assert KITTI.recognises(source), f"{source} is not a sequence of KITTI"
    summary = drive_import.import_drive(KITTI.open(source, raw_frame.ReadOptions()), output)
    print(f"{summary.frames} images along {summary.path_m or 0:.1f} m became {output}")
    print(*summary.findings, sep="\n")
