"""Writes a drive as GNM, ViNT and NoMaD are trained from: `0.jpg`, `1.jpg`, ... and `traj_data.pkl`.

`camera.json` says what the lens is, as our own reader takes it.
"""

import pickle
from pathlib import Path

import numpy as np

from ltvn_core.exporting.exported_drive import ExportedDrive


def write_vint_folder(drive: ExportedDrive, folder: Path) -> None:
    """Fill a folder, which exists and is empty, with images and odometry; depth and stamps have no place there.

    Raises OSError.
    """
    poses = []
    for number, frame in enumerate(drive.frames()):
        (folder / f"{number}.jpg").write_bytes(frame.jpeg)
        poses.append(frame.odometry)
    drive.write_camera(folder)
    held = np.array(poses, np.float64)
    (folder / "traj_data.pkl").write_bytes(pickle.dumps({"position": held[:, :2].copy(), "yaw": held[:, 2].copy()}, 4))
