"""Chooses the body of a simulated robot on this machine: PyBullet's if installed, else a disc in the plane."""

import logging
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.simulation.body import Body
from ltvn_core.simulation.body_names import BodyName, KnownBody
from ltvn_core.simulation.planar_body import PlanarBody
from ltvn_core.types import Pose

log = logging.getLogger(__name__)


def choose_body(wanted: BodyName = "auto") -> KnownBody:
    """Return the body to use; `auto` is Bullet if PyBullet can be imported.

    Raises SceneError if Bullet is requested and PyBullet is missing.
    """
    if wanted == "planar":
        return wanted
    if _bullet_missing() is None:
        return "bullet"
    if wanted == "bullet":
        raise SceneError(
            f"--body bullet needs PyBullet, which cannot be imported here ({_bullet_missing()}). Use --body planar, "
            "which needs no package, or install it: pip install 'ltvn[sim]' installs it for Linux x86-64 and macOS "
            "arm64."
        )
    return "planar"


def open_body(
    wanted: BodyName, vertices: NDArray[np.floating], faces: NDArray[np.integer], start: Pose, spec: RobotSpec
) -> Body:
    """Create a body at `start` (3,) among triangles with vertices (V, 3) and faces (F, 3).

    Raises SceneError if Bullet is requested and PyBullet is missing.
    """
    body = choose_body(wanted)
    _announce(body)
    if body == "planar":
        return PlanarBody(vertices, faces, start, spec)
    # Imported here, because PyBullet has no wheel for most platforms.
    from ltvn_core.simulation.bullet_body import BulletBody

    return BulletBody(vertices, faces, start, spec)


@cache
def _announce(body: KnownBody) -> None:
    """Log once per process which body is used."""
    log.info("The simulated robot's body is %s.", "PyBullet's" if body == "bullet" else "planar, without PyBullet")


@cache
def _bullet_missing() -> str | None:
    """Return the reason why PyBullet cannot be imported; None if it can."""
    try:
        import pybullet  # noqa: F401
    except ImportError as error:
        return str(error)
    return None
