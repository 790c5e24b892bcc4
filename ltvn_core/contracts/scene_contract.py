"""What a scene must be: a floor on which a robot can stand, with something to see."""

from collections.abc import Iterator

import numpy as np

from ltvn_core.contracts.contract_check import ContractCheck, require, run_checks
from ltvn_core.plugins import Plugin
from ltvn_core.simulation.scene_registry import load_scene

POSES = 10


def scene_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Open a scene and look for a place to stand."""
    return run_checks(
        ("opens by its name", lambda: _opens(plugin)),
        [
            ("has free floor", lambda: _has_floor(plugin)),
            ("has something to see", lambda: _has_surfaces(plugin)),
        ],
    )


def _opens(plugin: Plugin) -> str:
    scene = load_scene(plugin.name)
    require(scene.address == plugin.name, f"its address is {scene.address!r}, by which nobody finds it again")
    return f"{scene.area_m2:.0f} m2"


def _has_floor(plugin: Plugin) -> str:
    clearance = load_scene(plugin.name).clearance
    poses = clearance.sample_poses(np.random.default_rng(0), POSES)
    require(bool(np.all(clearance.at(poses[:, :2]) > 0)), "free places lie within obstacles")
    return f"{clearance.navigable.sum() * clearance.resolution_m**2:.0f} m2 to drive on"


def _has_surfaces(plugin: Plugin) -> str:
    surfaces = load_scene(plugin.name).surfaces
    require(len(surfaces.faces) > 0, "it has no triangle")
    require(int(surfaces.faces.max()) < len(surfaces.vertices), "faces name vertices that there are not")
    require(int(surfaces.face_texture.max()) < len(surfaces.textures), "faces name textures that there are not")
    return f"{len(surfaces.faces):,} triangles"
