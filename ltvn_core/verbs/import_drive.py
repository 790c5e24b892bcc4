"""`ltvn import`: somebody else's drive becomes a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ImportVerb(Verb):
    """Make a recording of a drive in another format: a bag, a data set, a folder of pictures."""

    job = "ltvn_core.verbs.jobs.import_drive:import_recording"

    source: Positional[Path]
    """The file or folder."""
    output: Path
    """The recording to write; must not exist yet."""
    format: str = "auto"
    """The reader to use; auto finds out, and a wrong name lists those there are."""
    rgb: str | None = None
    """Topic, key or list of the colour images, where the reader finds the wrong one or several."""
    depth: str | None = None
    """Topic, key or list of the depth images; "none" leaves them out."""
    odometry: str | None = None
    """Topic or key of the odometry; for a folder of pictures a CSV file with the columns file (or stamp), x, y, yaw."""
    camera_info: str | None = None
    """Topic, key or file of the camera's description."""
    camera: str | None = None
    """The lens: fx,fy,cx,cy,width,height and where it is distorted k1,k2,p1,p2,k3; or a camera.json, which
    may say "fisheye": true, and by depth_scale the unit of depth."""
    fov: float | None = None
    """Horizontal field of view in degrees, where nothing else is known of the lens."""
    height: float | None = None
    """Height of the camera above the floor in metres."""
    pitch: float | None = None
    """Pitch of the camera in degrees; negative looks down."""
    odometry_from: Literal["auto", "source", "truth", "none"] = "auto"
    """Source of the recorded odometry: the source's own, the true poses, or none; auto is the first that exists."""
    every_m: float = 0.1
    """Keep an image after this distance by odometry, in metres; with 0 for this and --every-deg, all are kept. Without
    odometry an image is kept where the picture has changed."""
    every_deg: float = 8.0
    """Keep an image after this turn by odometry, in degrees."""
    rate: float | None = None
    """Images a second, for formats without stamps."""
    scene: str = ""
    """Name of the place in the recording; by default real: and the source's name."""
