"""How long it takes until body and camera meet a door that was closed, or something put down in a large scan."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.camera import TRIANGLES, quartered
from benchmarks.measurement import Measurement, measured
from ltvn_core import worlds as w
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot

_ROUNDS = 10
_BUDGET_MS = 300.0


def change_worlds() -> list[Measurement]:
    """Change the largest apartment, and one cut up into as many triangles as a scan, and look at each at once."""
    apartment = load_scene("apartment-129")
    surfaces = apartment.surfaces
    while len(surfaces.faces) < TRIANGLES:
        surfaces = quartered(surfaces)
    scan = replace(apartment, surfaces=surfaces)
    box = w.ThingPlaced("box", w.ThingKind.BOX, (*_free_place(apartment), 0.3), (0.4, 0.4, 0.5))
    piece = w.OWN_PREFIX + apartment.parts.furniture[0].name
    jobs: tuple[tuple[str, Scene, w.WorldChange, w.WorldChange], ...] = (
        ("door to body and camera", apartment, w.DoorMoved(2, is_open=False), w.DoorMoved(2, is_open=True)),
        (f"box put down among {len(surfaces.faces):,} triangles", scan, box, w.ThingRemoved("box")),
        ("furniture taken away, to body and camera", apartment, w.ThingRemoved(piece), w.ThingReturned(piece)),
        ("light", apartment, w.LightChanged(0.5), w.LightChanged(1.0)),
    )
    return [
        measured(name, _longest_ms(scene, change, back), "ms", at_most=_BUDGET_MS) for name, scene, change, back in jobs
    ]


def _longest_ms(scene: Scene, change: w.WorldChange, back: w.WorldChange) -> float:
    """Return the longest time from a change, or its opposite, to the next image."""
    robot = SimulatedRobot(
        scene,
        EmbreeRenderer(scene.surfaces),
        start=scene.clearance.sample_poses(np.random.default_rng(1), 1, min_clearance_m=0.5)[0],
        rng=np.random.default_rng(0),
        world=World(scene),
    )
    robot.observe()
    times = [_ms(lambda each=each: (robot.apply(each), robot.observe())) for each in (change, back) * _ROUNDS]
    robot.close()
    return max(times)


def _free_place(scene: Scene) -> tuple[float, float]:
    x, y, _ = scene.clearance.sample_poses(np.random.default_rng(5), 1, min_clearance_m=0.6)[0].tolist()
    return x, y


def _ms(job: Callable[[], object]) -> float:
    start = time.perf_counter()
    job()
    return 1000 * (time.perf_counter() - start)
