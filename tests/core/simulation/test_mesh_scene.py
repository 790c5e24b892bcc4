"""Scenes that somebody else made: what a robot in them relies on, and what is said when a file is no scene."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import PluginError, SceneError
from ltvn_core.plugins import SCENES, find_plugins
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.meshes.mesh_textures import TextureCollector
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene, scene_names
from ltvn_core.types import Twist
from ltvn_core.verbs.collect import CollectSummary, CollectVerb
from ltvn_core.verbs.plugins import broken_contract
from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M, cut_away
from tests.core.plugin_packages import install
from tests.core.simulation.two_room_mesh import BLUE, HEIGHT, RED, box_house, save

LENS = LOCOBOT.camera
KINDS = [
    ("house.glb", "texture", "y"),
    ("house.glb", "vertex", "y"),
    ("house.glb", "texture", "z"),
    ("house.gltf", "texture", "y"),
    ("house.obj", "material", "z"),
    ("house.obj", "texture", "y"),
    ("house.ply", "vertex", "z"),
    ("house.ply", "vertex", "y"),
]


@pytest.fixture(params=KINDS, ids=lambda kind: "-".join(kind))
def house(request: pytest.FixtureRequest, tmp_path: Path) -> Scene:
    file, paint, up = request.param
    return load_scene(str(save(box_house(paint, up=up, ground=1.3), tmp_path / file)))


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    return save(box_house(), tmp_path / "plain.glb")


def seen(scene: Scene, pose: tuple[float, float, float]) -> tuple[np.ndarray, float]:
    """Colour and depth in the middle of the picture from a pose."""
    rgb, depth = EmbreeRenderer(scene.surfaces).render(np.array(pose), LENS)
    return rgb[36, 48].astype(float), float(depth[36, 48])


def extent(scene: Scene) -> float:
    """Where the floor's middle is along y, which a y-up file turns over or not."""
    rows, _ = np.nonzero(scene.clearance.navigable)
    return float(scene.clearance.origin[1] + (rows.mean() + 0.5) * scene.clearance.resolution_m)


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_scan_without_floor_that_may_lie_on_its_side_is_doubted_and_a_whole_house_is_not(
    tmp_path: Path, up: str
) -> None:
    whole = box_house(up=up, scale=1.2)
    assert load_scene(str(save(whole, tmp_path / "whole.glb"))).doubts == ()
    bare = box_house(up=up, scale=1.2)
    bare.delete_geometry(list(bare.geometry)[:2])
    (doubt,) = load_scene(str(save(bare, tmp_path / "bare.glb"))).doubts
    assert "on its side" in doubt
    assert "bare.json" in doubt


def test_the_floor_lies_at_zero_and_the_free_floor_is_indoors(house: Scene) -> None:
    assert house.name == "house"
    assert house.surfaces.vertices[:, 2].max() == pytest.approx(HEIGHT + 0.1, abs=0.02)
    poses = house.clearance.sample_poses(np.random.default_rng(0), 200)
    assert poses[:, 0].min() > 0.15
    assert poses[:, 0].max() < 5.85
    assert np.ptp(poses[:, 1]) < 4.0
    assert (poses[:, 0] < 2.7).any()
    assert (poses[:, 0] > 3.3).any()
    assert house.area_m2 == pytest.approx(24.0, rel=0.15)


def test_the_camera_sees_the_walls_at_their_depth_and_in_their_colours(house: Scene) -> None:
    middle = extent(house)
    red, to_west = seen(house, (1.5, middle, np.pi))
    blue, to_east = seen(house, (4.0, middle, 0.0))
    assert (to_west, to_east) == (pytest.approx(1.5, abs=0.01), pytest.approx(2.0, abs=0.01))
    for colour, painted in ((red, RED), (blue, BLUE)):
        share = colour / np.array(painted)
        assert share.min() > 0.5
        assert np.ptp(share) < 0.15


def test_a_wall_stops_the_robot(plain: Path) -> None:
    simulation = open_simulation(str(plain), seed=0, start=np.array([1.0, 2.0, np.pi]))
    for _ in range(60):
        simulation.robot.drive(Twist(0.4, 0.0))
        simulation.robot.advance(0.1)
    assert simulation.robot.collisions == 1
    assert 0.15 < simulation.robot.exact_pose[0] < 0.3
    simulation.robot.close()


def test_the_doorway_is_a_way_between_the_rooms(plain: Path) -> None:
    way = load_scene(str(plain)).clearance.path((1.0, 3.5), (5.0, 3.5))
    assert way is not None
    at_the_wall = way[np.abs(way[:, 0] - 3.0).argmin()]
    assert 1.5 < at_the_wall[1] < 2.5


def test_seen_from_above_the_ceiling_is_gone_and_the_walls_are_closed(plain: Path) -> None:
    scene = load_scene(str(plain))
    cut = cut_away(scene.surfaces)
    assert cut.vertices[cut.faces][:, :, 2].max() < CUT_HEIGHT_M + 0.05
    corners = cut.vertices[cut.faces]
    lids = cut.only(np.asarray(np.all(corners[:, :, 2] > CUT_HEIGHT_M - 1e-3, axis=1)))
    area = trimesh.Trimesh(lids.vertices, lids.faces, process=False).area
    assert 1.5 < area < 4.0


def test_a_terrain_around_the_house_is_not_where_the_robot_starts(tmp_path: Path) -> None:
    house = box_house()
    house.add_geometry(trimesh.creation.box(bounds=[(-20, -20, -0.2), (26, 24, -0.02)]))
    scene = load_scene(str(save(house, tmp_path / "garden.glb")))
    poses = scene.clearance.sample_poses(np.random.default_rng(0), 100)
    assert poses[:, :2].min() > 0
    assert poses[:, 0].max() < 6


def test_of_a_house_without_a_ceiling_the_rooms_are_kept(tmp_path: Path) -> None:
    house = box_house()
    house.delete_geometry([name for name, part in house.geometry.items() if part.bounds[0, 2] > 2])
    scene = load_scene(str(save(house, tmp_path / "open.glb")))
    assert np.count_nonzero(scene.clearance.navigable) * 0.0025 == pytest.approx(18, rel=0.2)


def test_a_gibson_folder_is_a_scene_with_its_own_floor_and_map(tmp_path: Path) -> None:
    folder = tmp_path / "Space"
    save(box_house(ground=0.4), folder / "mesh_z_up.obj")
    (folder / "floors.txt").write_text("3.2\n0.4\n", encoding="utf-8")
    free = np.zeros((1600, 1600), np.uint8)
    free[800:1200, 800:1100] = 255  # The west room: x from 0 to 3 m, y from 0 to 4 m.
    cv2.imwrite(str(folder / "floor_trav_0.png"), free)
    scene = load_scene(str(folder))
    poses = scene.clearance.sample_poses(np.random.default_rng(0), 100)
    assert scene.name == "Space"
    assert poses[:, 0].max() < 3.0
    assert seen(scene, (1.5, 2.0, np.pi))[1] == pytest.approx(1.5, abs=0.01)


def test_the_notes_beside_a_mesh_say_its_unit_and_which_way_is_up(tmp_path: Path) -> None:
    path = save(box_house(scale=1000.0, up="y"), tmp_path / "millimetres.glb")
    (tmp_path / "millimetres.json").write_text('{"scale": 0.001, "up": "y"}', encoding="utf-8")
    assert load_scene(str(path)).area_m2 == pytest.approx(24.0, rel=0.15)


def test_a_scene_is_found_again_by_the_address_that_a_recording_remembers(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    address = load_scene("plain.glb").address
    assert Path(address) == plain
    (tmp_path / "elsewhere").mkdir()
    moved = plain.rename(tmp_path / "elsewhere" / "plain.glb")
    load_scene.cache_clear()
    with pytest.raises(SceneError, match="does not exist"):
        load_scene(address)
    monkeypatch.chdir(moved.parent)
    assert Path(load_scene(address).address) == moved


def test_a_recording_remembers_the_file_of_its_scene(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    collected = CollectVerb(output=tmp_path / "tour.rrd", scene="plain.glb", loops=1).run()
    assert isinstance(collected, CollectSummary)
    assert collected.scene == "plain"
    assert collected.collisions == 0
    assert Recording.open(tmp_path / "tour.rrd").meta.scene == str(plain)


def test_a_colour_that_runs_over_a_large_face_is_kept() -> None:
    part = trimesh.Trimesh([[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 2]], process=False)
    part.visual.vertex_colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]], np.uint8)  # pyright: ignore
    table = TextureCollector(linear_factors=False)
    painted = table.add_mesh(part)
    near_red = painted.triangles.sum(axis=(1, 2)).argmin()
    column, row = (painted.corner_uv[near_red, 0] * (256, -256)).astype(int)
    assert table.textures()[0][row - 1, column, 0] > 220


def wrong(tmp_path: Path, kind: str) -> Path:
    path = tmp_path / f"{kind}.ply"
    if kind == "text":
        path.write_text("no mesh at all", encoding="utf-8")
    elif kind == "points":
        trimesh.PointCloud(np.random.default_rng(0).random((50, 3))).export(path)
    elif kind == "narrow":
        save(trimesh.Scene([trimesh.creation.box(extents=(3.0, 0.3, 2.0))]), path)
    elif kind == "millimetres":
        save(box_house("vertex", scale=1000.0), path)
    elif kind == "doll":
        save(box_house("vertex", scale=0.01), path)
    elif kind == "folder":
        path.mkdir()
    return path


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("missing", "does not exist"),
        ("text", "cannot be read as a PLY"),
        ("points", "no triangles"),
        ("narrow", "no floor that is wide enough"),
        ("millimetres", "150 m wide"),
        ("doll", "150 m wide"),
        ("folder", "no mesh_z_up.obj"),
    ],
)
def test_what_is_no_scene_is_refused_with_the_reason(tmp_path: Path, kind: str, said: str) -> None:
    path = wrong(tmp_path, kind)
    with pytest.raises(SceneError, match=said) as refused:
        load_scene(str(path))
    assert str(path) in str(refused.value)


def test_other_formats_and_wrong_notes_are_refused(plain: Path) -> None:
    with pytest.raises(SceneError, match=r"\.glb, \.gltf, \.obj, \.ply"):
        load_scene(str(plain.rename(plain.with_suffix(".fbx"))))
    path = save(box_house(), plain)
    path.with_suffix(".json").write_text('{"up": "north"}', encoding="utf-8")
    with pytest.raises(SceneError, match='"up" must be "y" or "z"'):
        load_scene(str(path))


@pytest.mark.parametrize(
    ("note", "said"),
    [
        ('{"scale": true}', "finite number"),
        ('{"scale": 1e999}', "finite number"),
        (f'{{"scale": {10**400}}}', "too large"),
        ('{"floor_height": NaN}', "finite number"),
        ("[1, 2]", "cannot be read"),
    ],
)
def test_a_setting_that_is_no_number_is_refused(plain: Path, note: str, said: str) -> None:
    plain.with_suffix(".json").write_text(note, encoding="utf-8")
    with pytest.raises(SceneError) as refused:
        load_scene(str(plain))
    assert said in str(refused.value)
    assert "plain.json" in str(refused.value)


def test_what_is_no_setting_is_named_and_let_alone(plain: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    notes = '{"scael": 0.001, "name": "a", "units": "m", "bounds": [[0, 0, 0], [1, 1, 1]], "triangles": 3, '
    plain.with_suffix(".json").write_text(
        notes + '"textures": 2, "free_area_m2": 1.0, "licence": "MIT", "file_mb": 1.0, "scale": 1.0, "up": "z"}',
        encoding="utf-8",
    )
    assert load_scene(str(plain)).area_m2 == pytest.approx(24.0, rel=0.15)
    assert "scael" in caplog.text


def test_a_mesh_in_coordinates_of_the_earth_is_refused(tmp_path: Path) -> None:
    path = save(box_house("vertex").apply_translation((500_000, 4_500_000, 120)), tmp_path / "surveyed.ply")
    with pytest.raises(SceneError, match=r"far from its origin, at \(500, 4,500, 0\) km"):
        load_scene(str(path))


def test_a_mesh_a_few_kilometres_from_its_origin_is_a_scene(tmp_path: Path) -> None:
    moved = save(box_house().apply_translation((4_000, -3_000, 120)), tmp_path / "campus.glb")
    assert load_scene(str(moved)).area_m2 == pytest.approx(24.0, rel=0.15)


def test_a_map_of_a_floor_that_the_mesh_does_not_have_is_refused(tmp_path: Path) -> None:
    folder, house = tmp_path / "Space", box_house()
    house.delete_geometry([name for name, part in house.geometry.items() if part.bounds[1, 2] < 0.05])
    save(house, folder / "mesh_z_up.obj")
    (folder / "floors.txt").write_text("0.0\n", encoding="utf-8")
    cv2.imwrite(str(folder / "floor_trav_0.png"), np.full((1600, 1600), 255, np.uint8))
    with pytest.raises(SceneError, match="no floor that is wide enough"):
        load_scene(str(folder))


def test_a_mesh_in_which_nothing_is_seen_is_refused_before_anything_is_driven(tmp_path: Path) -> None:
    # A small floor far below a roof, without walls: the camera looks into the open everywhere.
    parts = [((0, 0, -0.1), (1.6, 1.6, 0.0)), ((0, 0, 9.0), (1.6, 1.6, 9.1))]
    scene = trimesh.Scene([trimesh.creation.box(bounds=part) for part in parts])
    path = save(scene, tmp_path / "platform.glb")
    (tmp_path / "platform.json").write_text('{"up": "z", "floor_height": 0.0}', encoding="utf-8")
    with pytest.raises(SceneError, match="those from 11 more places on its floor, are blank"):
        open_simulation(str(path), seed=0)


def test_a_scene_of_another_package_is_found_by_its_name_and_keeps_the_contract(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "from pathlib import Path\ndef two_rooms(): return Path(__file__).with_name('house.glb')\n"
    save(box_house(), tmp_path / "house.glb")
    install(tmp_path, "two_houses", "[ltvn.scenes]\ntwo-rooms = two_houses:two_rooms\n", source=source)
    monkeypatch.syspath_prepend(str(tmp_path))

    assert scene_names()[-1] == "two-rooms"
    assert (load_scene("two-rooms").name, load_scene("two-rooms").address) == ("two-rooms", "two-rooms")
    assert broken_contract(find_plugins(SCENES)["two-rooms"]) == ""


def test_a_broken_scene_is_refused_with_the_name_of_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "def nothing(): return 7\n"
    install(tmp_path, "empty_houses", "[ltvn.scenes]\nnothing = empty_houses:nothing\n", source=source)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PluginError, match=r"scene nothing of the package empty_houses .*returns int, not a Scene"):
        load_scene("nothing")
