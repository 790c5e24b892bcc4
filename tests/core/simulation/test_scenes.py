"""Scenes are what their names promise, the same everywhere, and survive a damaged cache."""

import hashlib
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from ltvn_core.errors import SceneError
from ltvn_core.simulation import scene_registry
from ltvn_core.simulation.apartments.generation import Building, generate_apartment
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.scene_glb import to_glb
from ltvn_core.simulation.scene_registry import Scene, load_scene, scene_names
from ltvn_core.simulation.surfaces import Surfaces

SMALLEST = "train-00"
GOLDEN_SEED, GOLDEN_AREA_M2 = 3, 45.0
GOLDEN_SHA256 = "3ad4ef401f8787d57dba8c8b6896822ff1f58d7b3943ce8a70044411c56aa4d3"
BODY_HEIGHTS_M = (0.06, 0.9)
"""What stands between these heights can be bumped into; rugs and thresholds lie below."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SMALLEST)


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache of this test's own, in which nothing lies yet."""
    monkeypatch.setattr("ltvn_core.simulation.scene_registry.cache_folder", lambda: tmp_path)
    load_scene.cache_clear()
    yield tmp_path
    load_scene.cache_clear()


def test_an_unknown_scene_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(SceneError) as refused:
        load_scene("castle")
    assert "'castle'" in str(refused.value)
    assert all(name in str(refused.value) for name in scene_names())


def test_all_families_of_scenes_have_names() -> None:
    names = scene_names()
    assert {"demo", "apartment-57", "apartment-70", "apartment-124", "apartment-129"} <= set(names)
    assert [f"train-{k:02d}" for k in range(40)] == [name for name in names if name.startswith("train-")]
    tuning = [*(f"tune-{k}" for k in range(9)), *(f"tune-twin-{k}" for k in range(4))]
    tuning += [f"tune-narrow-{k}" for k in range(2)] + [f"tune-office-{k}" for k in range(4)]
    tuning += [f"tune-{family}-{k}" for family in ("plain", "shop", "hall") for k in range(4)]
    tuning += [f"tune-tables-{k}" for k in range(2)] + [f"tune-wings-{k}" for k in range(4)]
    assert {f"{family}-{k}" for family in ("office", "plain", "shop", "hall", "wings") for k in range(4)} <= set(names)
    assert tuning == [name for name in names if name.startswith("tune-")]


@pytest.mark.parametrize("area_m2", [57, 70, 124, 129])
def test_a_test_apartment_is_as_large_as_its_name_says(area_m2: int) -> None:
    assert load_scene(f"apartment-{area_m2}").area_m2 == pytest.approx(area_m2, rel=0.02)


def test_no_scene_for_testing_or_tuning_is_grown_from_a_seed_of_training() -> None:
    recipes = scene_registry._recipes()
    seeds = [recipe.seed for recipe in recipes.values()]
    assert len(set(seeds)) == len(seeds)
    training = {recipe.seed for name, recipe in recipes.items() if name.startswith("train-")}
    assert len(training) == 40
    assert not training & {recipe.seed for name, recipe in recipes.items() if not name.startswith("train-")}


@settings(max_examples=6)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(45, 130))
def test_a_robot_gets_from_any_free_place_to_any_other_in_every_apartment(seed: int, area_m2: float) -> None:
    apartment = generate_apartment(seed, area_m2)
    clearance = ClearanceMap(apartment.blocked, apartment.origin)
    # Between a round pot and two walls there may be room for a robot that nobody could have put there.
    assert np.count_nonzero(clearance.grid > PLANNING_CLEARANCE_M) < 1.01 * np.count_nonzero(clearance.navigable)
    assert apartment.plan.width * apartment.plan.depth == pytest.approx(area_m2, rel=0.03)


def test_an_apartment_is_the_same_on_every_machine() -> None:
    """A change here means other apartments: raise GENERATOR_VERSION, and train anew if they look different."""
    assert _digest(generate_apartment(GOLDEN_SEED, GOLDEN_AREA_M2)) == GOLDEN_SHA256


def test_a_scene_from_the_cache_equals_the_one_that_was_put_there(empty_cache: Path) -> None:
    made = load_scene(SMALLEST)
    load_scene.cache_clear()
    kept = load_scene(SMALLEST)
    assert kept is not made
    assert (kept.name, kept.area_m2, kept.rooms) == (made.name, made.area_m2, made.rooms)
    assert _bytes_of(kept.surfaces) == _bytes_of(made.surfaces)
    assert np.array_equal(kept.clearance.blocked, made.clearance.blocked)
    assert np.array_equal(kept.clearance.origin, made.clearance.origin)


@pytest.mark.parametrize("damage", ["empty", "cut", "garbage", "flipped", "foreign"])
def test_a_damaged_cache_is_made_again(damage: str, empty_cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    made = load_scene(SMALLEST)
    (file,) = _files(empty_cache)
    file.write_bytes(_damaged(file.read_bytes(), damage))
    load_scene.cache_clear()
    again = load_scene(SMALLEST)
    assert _bytes_of(again.surfaces) == _bytes_of(made.surfaces)
    assert "damaged" in caplog.text
    caplog.clear()
    load_scene.cache_clear()
    load_scene(SMALLEST)
    assert "damaged" not in caplog.text


def test_a_changed_recipe_is_not_served_from_an_old_cache(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = load_scene(SMALLEST)
    for recipe in (scene_registry._Recipe(77, 45.0), scene_registry._Recipe(1000, 50.0)):
        monkeypatch.setitem(scene_registry._RECIPES, SMALLEST, recipe)
        load_scene.cache_clear()
        assert _bytes_of(load_scene(SMALLEST).surfaces) != _bytes_of(old.surfaces)


def test_a_scene_loads_where_nothing_can_be_cached(empty_cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    (empty_cache / "scenes").write_text("A file stands where the folder should be.", encoding="utf-8")
    assert load_scene(SMALLEST).rooms
    assert "could not be cached" in caplog.text


def test_the_drawing_without_a_ceiling_is_small_and_loads(scene: Scene) -> None:
    open_above, closed = scene.glb(), to_glb(scene.surfaces)
    assert len(open_above) < 4_000_000
    drawing = trimesh.load_scene(io.BytesIO(open_above), file_type="glb")
    # The rooms' floors reach into the outer walls' middle at most, so the drawing is as large as the apartment.
    (x0, y0, z0), (x1, y1, z1) = np.asarray(drawing.bounds)
    assert (x1 - x0) * (y1 - y0) == pytest.approx(scene.area_m2, rel=0.1)
    assert z0 > -0.1
    assert 2.4 < z1 < 2.8
    with_ceiling = trimesh.load_scene(io.BytesIO(closed), file_type="glb")
    assert _face_count(with_ceiling) > _face_count(drawing)


@pytest.mark.parametrize("name", [SMALLEST, "apartment-57"])
def test_nothing_that_a_robot_could_bump_into_stands_outside_the_blocked_floor(name: str) -> None:
    scene = load_scene(name)
    clearance = scene.clearance
    points = _points_on(scene.surfaces, BODY_HEIGHTS_M)
    columns, rows = _cells_of(points, clearance)
    grown = ndimage.binary_dilation(clearance.blocked, np.ones((3, 3), bool))
    assert len(points) > 10_000
    assert grown[rows, columns].all()


@pytest.mark.parametrize("name", [SMALLEST, "tune-narrow-1"])
def test_nothing_stands_in_the_way_that_cannot_be_seen(name: str) -> None:
    scene = load_scene(name)
    blocked, seen = scene.clearance.blocked, np.zeros_like(scene.clearance.blocked)
    columns, rows = _cells_of(_points_on(scene.surfaces, BODY_HEIGHTS_M, steps=61), scene.clearance)
    seen[rows, columns] = True
    edges = np.logical_and(blocked, ndimage.binary_dilation(~blocked))
    beside_something = np.asarray(ndimage.binary_dilation(seen, np.ones((3, 3), bool)), bool)
    assert not edges[~beside_something].any()


def test_what_stops_the_robot_covers_the_blocked_floor_and_no_more(scene: Scene) -> None:
    vertices, faces = scene.collision_triangles()
    clearance = scene.clearance
    tops = vertices[faces][(vertices[faces][..., 2] > 0.5).all(1)][..., :2]
    (ax, ay), (bx, by) = (tops[:, 1] - tops[:, 0]).T, (tops[:, 2] - tops[:, 0]).T
    area_m2 = np.abs(ax * by - ay * bx).sum() / 2
    assert area_m2 == pytest.approx(np.count_nonzero(clearance.blocked) * clearance.resolution_m**2)


def _digest(apartment: Building) -> str:
    floor = (apartment.blocked.astype(np.uint8), apartment.origin.astype("<f8"))
    return hashlib.sha256(b"".join(array.tobytes() for array in floor) + _bytes_of(apartment.surfaces)).hexdigest()


def _bytes_of(surfaces: Surfaces) -> bytes:
    shape = (surfaces.vertices.astype("<f4"), surfaces.faces.astype("<i4"), surfaces.corner_uv.astype("<f4"))
    looks = (surfaces.face_texture.astype("<i4"), surfaces.overhead.astype(np.uint8), *surfaces.textures)
    return b"".join(array.tobytes() for array in (*shape, *looks))


def _files(cache: Path) -> list[Path]:
    return [path for path in cache.rglob("*") if path.is_file()]


def _damaged(content: bytes, damage: str) -> bytes:
    if damage == "foreign":
        other = io.BytesIO()
        np.savez(other, something=np.arange(3))
        return other.getvalue()
    middle = len(content) // 2
    return {
        "empty": b"",
        "cut": content[:middle],
        "garbage": b"not an archive " * 1000,
        "flipped": content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :],
    }[damage]


def _cells_of(points: NDArray[np.float64], clearance: ClearanceMap) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return columns and rows (N,); beyond the grid lies only the outside of the outer walls."""
    cells = np.floor((points - clearance.origin) / clearance.resolution_m).astype(np.intp)
    height, width = clearance.blocked.shape
    return np.clip(cells[:, 0], 0, width - 1), np.clip(cells[:, 1], 0, height - 1)


def _face_count(drawing: trimesh.Scene) -> int:
    return sum(len(part.faces) for part in drawing.geometry.values() if isinstance(part, trimesh.Trimesh))


def _points_on(surfaces: Surfaces, heights_m: tuple[float, float], *, steps: int = 31) -> NDArray[np.float64]:
    """Return the ground plan (N, 2) of points spread over all triangles (all corners too) between two heights."""
    shares = np.linspace(0, 1, steps)
    first, second = (weights.ravel() for weights in np.meshgrid(shares, shares))
    weights = np.column_stack([1 - first - second, first, second])[first + second <= 1 + 1e-9]
    corners = surfaces.vertices[surfaces.faces].astype(np.float64)
    z = corners[..., 2]
    corners = corners[(z.max(1) > heights_m[0]) & (z.min(1) < heights_m[1])]
    points = np.einsum("pc,fcx->fpx", weights, corners).reshape(-1, 3)
    return points[(points[:, 2] > heights_m[0]) & (points[:, 2] < heights_m[1]), :2]
