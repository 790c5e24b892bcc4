"""A 3D model of the LoCoBot, built from primitives with its real dimensions, for display only.

The physics models the robot as a cylinder, and the renderers never show it.
"""

from collections import defaultdict
from functools import lru_cache
from typing import TypeAlias, cast

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from ltvn_core.robots.robot_spec import LOCOBOT

Point3: TypeAlias = tuple[float, float, float]
PaintedMesh: TypeAlias = tuple[str, trimesh.Trimesh]

BASE_RADIUS_M = LOCOBOT.radius_m
CAMERA_HEIGHT_M = LOCOBOT.camera.height_m

_PAINTS: dict[str, tuple[tuple[float, float, float], float, float]] = {
    # Name: linear RGB colour, metallic factor, roughness factor (glTF materials).
    "charcoal": ((0.045, 0.047, 0.052), 0.1, 0.55),
    "rubber": ((0.02, 0.02, 0.02), 0.0, 0.9),
    "graphite": ((0.16, 0.17, 0.18), 0.3, 0.5),
    "aluminium": ((0.62, 0.64, 0.66), 0.7, 0.35),
    "silver": ((0.78, 0.79, 0.81), 0.4, 0.35),
    "lens": ((0.01, 0.015, 0.04), 0.2, 0.1),
    "orange": ((0.95, 0.35, 0.04), 0.0, 0.45),
    "green": ((0.1, 0.75, 0.25), 0.0, 0.4),
    "blue": ((0.08, 0.35, 0.9), 0.0, 0.4),
    "red": ((0.8, 0.07, 0.06), 0.0, 0.4),
}


@lru_cache(maxsize=1)
def locobot_glb() -> bytes:
    """Return the robot as binary glTF: metres, z up, x forward, origin on the floor below the centre of the base."""
    pieces: dict[str, list[trimesh.Trimesh]] = defaultdict(list)
    for paint, mesh in [*_base(), *_decks(), *_tower(), *_arm()]:
        pieces[paint].append(mesh)
    scene = trimesh.Scene()
    for paint, meshes in pieces.items():
        scene.add_geometry(_painted(meshes, paint), node_name=paint, geom_name=paint)
    return cast(bytes, scene.export(file_type="glb"))


def _base() -> list[PaintedMesh]:
    """The Kobuki: body, bumper, wheels, buttons."""
    wheels = [("rubber", _cylinder(0.035, 0.022, (0, side * 0.115, 0.035), axis="y")) for side in (-1, 1)]
    casters = [("rubber", trimesh.creation.icosphere(subdivisions=2, radius=0.016)) for _ in range(2)]
    for (_, ball), x_m in zip(casters, (0.115, -0.135), strict=True):
        ball.apply_translation((x_m, 0, 0.016))
    buttons = [
        ("green", _cylinder(0.009, 0.004, (-0.135, 0.03, 0.116))),
        ("red", _cylinder(0.009, 0.004, (-0.135, 0.0, 0.116))),
        ("blue", _cylinder(0.009, 0.004, (-0.135, -0.03, 0.116))),
    ]
    return [
        ("charcoal", _cylinder(BASE_RADIUS_M - 0.004, 0.055, (0, 0, 0.0475))),
        ("graphite", _cylinder(BASE_RADIUS_M, 0.022, (0, 0, 0.086))),
        ("charcoal", _cylinder(BASE_RADIUS_M - 0.006, 0.017, (0, 0, 0.1055))),
        ("silver", _ring(BASE_RADIUS_M - 0.03, BASE_RADIUS_M - 0.022, 0.002, (0, 0, 0.115))),
        ("blue", _box((0.006, 0.06, 0.008), (BASE_RADIUS_M - 0.003, 0, 0.102))),
        *wheels,
        *casters,
        *buttons,
    ]


def _decks() -> list[PaintedMesh]:
    """Two round plates on posts, with the computer and the battery between them."""
    corners = [(x_m, y_m) for x_m in (-0.1, 0.1) for y_m in (-0.095, 0.095)]
    posts = [("aluminium", _cylinder(0.006, 0.19, (x_m, y_m, 0.209), sections=12)) for x_m, y_m in corners]
    return [
        *posts,
        ("graphite", _cylinder(0.16, 0.006, (0, 0, 0.19))),
        ("graphite", _cylinder(0.16, 0.006, (0, 0, 0.304))),
        ("silver", _ring(0.156, 0.1605, 0.0062, (0, 0, 0.304))),
        ("charcoal", _box((0.12, 0.115, 0.045), (0.01, 0, 0.216))),
        ("blue", _box((0.002, 0.03, 0.006), (0.071, 0.02, 0.22))),
        ("silver", _box((0.14, 0.08, 0.03), (-0.01, 0, 0.13))),
    ]


def _tower() -> list[PaintedMesh]:
    """The mast with the pan-tilt head and the depth camera at the height of its optical centre."""
    lenses = [("lens", _cylinder(0.0075, 0.004, (0.036, y_m, CAMERA_HEIGHT_M), axis="x")) for y_m in (-0.03, 0, 0.03)]
    return [
        ("graphite", _box((0.05, 0.06, 0.02), (-0.06, 0, 0.317))),
        ("aluminium", _box((0.02, 0.04, 0.21), (-0.06, 0, 0.43))),
        ("aluminium", _box((0.075, 0.04, 0.006), (-0.03, 0, 0.533))),
        ("charcoal", _box((0.028, 0.034, 0.03), (-0.005, 0, 0.551))),
        ("orange", _cylinder(0.013, 0.006, (-0.005, 0, 0.569))),
        ("charcoal", _box((0.024, 0.03, 0.036), (-0.002, 0, 0.59))),
        ("orange", _cylinder(0.01, 0.04, (-0.002, 0, CAMERA_HEIGHT_M), axis="y")),
        ("silver", _box((0.024, 0.09, 0.025), (0.023, 0, CAMERA_HEIGHT_M))),
        *lenses,
    ]


def _arm() -> list[PaintedMesh]:
    """The arm on the upper deck, folded so that it stays inside the footprint and below the camera."""
    shoulder = (0.07, 0, 0.375)
    elbow = (-0.015, 0, 0.475)
    wrist = (0.1, 0, 0.425)
    tip = (0.135, 0, 0.41)
    joints = [("orange", _cylinder(0.017, 0.062, joint, axis="y")) for joint in (shoulder, elbow, wrist)]
    fingers = [("red", _link((0.14, side * 0.018, 0.408), (0.168, side * 0.012, 0.396), 0.006)) for side in (-1, 1)]
    return [
        ("charcoal", _cylinder(0.04, 0.03, (0.07, 0, 0.322))),
        ("orange", _cylinder(0.034, 0.008, (0.07, 0, 0.341))),
        ("charcoal", _box((0.036, 0.044, 0.045), (0.07, 0, 0.365))),
        ("graphite", _link(shoulder, elbow, 0.028)),
        ("graphite", _link(elbow, wrist, 0.026)),
        ("charcoal", _link(wrist, tip, 0.03)),
        ("silver", _box((0.008, 0.055, 0.02), (0.137, 0, 0.409))),
        *joints,
        *fingers,
    ]


def _cylinder(radius: float, height: float, centre: Point3, *, axis: str = "z", sections: int = 40) -> trimesh.Trimesh:
    mesh = trimesh.creation.cylinder(radius=radius, height=height, sections=sections)
    turned = {"x": (0, 1, 0), "y": (1, 0, 0)}.get(axis)
    if turned:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, turned))
    mesh.apply_translation(centre)
    return mesh


def _ring(inner: float, outer: float, height: float, centre: Point3) -> trimesh.Trimesh:
    mesh = trimesh.creation.annulus(r_min=inner, r_max=outer, height=height, sections=48)
    mesh.apply_translation(centre)
    return mesh


def _box(size: Point3, centre: Point3) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents=size)
    mesh.apply_translation(centre)
    return mesh


def _link(start: Point3, end: Point3, width: float) -> trimesh.Trimesh:
    """Return a bar from one joint to the next."""
    along = np.subtract(end, start)
    mesh = trimesh.creation.box(extents=(width, width, float(np.linalg.norm(along))))
    mesh.apply_transform(trimesh.geometry.align_vectors((0, 0, 1), along))
    mesh.apply_translation(np.add(start, end) / 2)
    return mesh


def _painted(meshes: list[trimesh.Trimesh], paint: str) -> trimesh.Trimesh:
    colour, metallic, roughness = _PAINTS[paint]
    whole = cast(trimesh.Trimesh, trimesh.util.concatenate(meshes))
    material = PBRMaterial(
        name=paint, baseColorFactor=(*colour, 1.0), metallicFactor=metallic, roughnessFactor=roughness
    )
    whole.visual = TextureVisuals(material=material)
    return whole
