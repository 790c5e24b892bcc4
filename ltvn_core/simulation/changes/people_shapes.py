"""What people look like: two legs, a long wide coat, arms and a head, in clothes of their own."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.tiling_textures import cloth, hsv_colour, plain
from ltvn_core.simulation.body import PERSON_HEIGHT_M, PERSON_RADIUS_M
from ltvn_core.simulation.surface_builder import SurfaceBuilder
from ltvn_core.simulation.surfaces import Surfaces, joined
from ltvn_core.worlds.world_change import Outline, PersonMoved

_HEM_M, _WAIST_M = 0.12, 0.85
"""From how high to how high the wide part of the coat reaches,"""
_INSIDE_M = 0.002
"""and how far inside of what can be touched it stays."""


def person_outline(person: PersonMoved) -> Outline:
    """Return where a person stands."""
    x, y, yaw = person.pose
    return Outline(x=x, y=y, yaw=yaw, width=2 * PERSON_RADIUS_M, depth=2 * PERSON_RADIUS_M, height=PERSON_HEIGHT_M)


def people_surfaces(people: tuple[PersonMoved, ...]) -> Surfaces | None:
    """Return people where they stand; None if there are none.

    The same people give the same textures wherever they walk, so that a renderer prepares these once.
    """
    if not people:
        return None
    crowd = _crowd(tuple(person.seed for person in people))
    poses = np.array([person.pose for person in people], np.float64)[crowd.owner]
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, z = crowd.surfaces.vertices.T.astype(np.float64)
    at = np.stack([poses[:, 0] + cos * x - sin * y, poses[:, 1] + sin * x + cos * y, z], axis=-1)
    return replace(crowd.surfaces, vertices=at.astype(np.float32))


class _Crowd(NamedTuple):
    """Several people, each in a frame of its own: x ahead, y to the left, the origin on the floor."""

    surfaces: Surfaces
    owner: NDArray[np.intp]
    """(V,) to which of the people each vertex belongs."""


@lru_cache(maxsize=8)
def _crowd(seeds: tuple[int, ...]) -> _Crowd:
    bodies = [_body(seed) for seed in seeds]
    return _Crowd(joined(bodies), np.repeat(np.arange(len(bodies)), [len(body.vertices) for body in bodies]))


@lru_cache(maxsize=32)
def _body(seed: int) -> Surfaces:
    rng = SeededRng(np.random.default_rng((13, seed)))
    builder = SurfaceBuilder()
    trousers = builder.texture(cloth(rng, hsv_colour(rng.uniform(0.5, 0.75), rng.uniform(0.1, 0.6), 0.4)))
    coat = builder.texture(cloth(rng, hsv_colour(rng.uniform(0, 1), rng.uniform(0.3, 0.8), rng.uniform(0.4, 0.9))))
    skin = builder.texture(plain(rng, hsv_colour(0.07, rng.uniform(0.25, 0.6), rng.uniform(0.4, 0.95)), 32))
    hair = builder.texture(plain(rng, hsv_colour(0.08, 0.5, rng.uniform(0.1, 0.6)), 32))
    for side in (-1, 1):
        builder.cylinder(trousers, (0.0, 0.11 * side, 0.0), 0.1, 0.85, top_radius=0.13)
        builder.cylinder(coat, (0.0, 0.2 * side, 0.75), 0.05, 0.65, sides=8)
    # As wide as what a robot can touch: the camera must not see thin legs where the bumper meets a wide body.
    builder.cylinder(coat, (0.0, 0.0, _HEM_M), PERSON_RADIUS_M - _INSIDE_M, _WAIST_M - _HEM_M, sides=24)
    builder.cylinder(coat, (0.0, 0.0, _WAIST_M), 0.22, 1.42 - _WAIST_M, top_radius=0.17, sides=16)
    builder.cylinder(skin, (0.0, 0.0, 1.42), 0.09, 0.2)
    builder.cylinder(hair, (0.0, 0.0, 1.62), 0.1, 0.08, top_radius=0.06)
    return builder.build()
