"""The scene itself, against a real viser server without a browser: what stays drawn when it is another one."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.errors import SceneError
from ltvn_core.navigation.event_table import NavigationProgress
from ltvn_core.worlds import AS_MADE, WorldState
from ltvn_viz.layers.first_view import USUAL_ASPECT, Floor
from ltvn_viz.layers.floor_plan import FloorPlanLayer, draw_floor_plan
from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M
from ltvn_viz.layers.scene_layer import LINGER_S, SceneLayer
from ltvn_viz.session.snapshot import FloorPlanView, Snapshot
from ltvn_viz.timeline.run_moment import RunMoment
from tests.core.data.importing.plan_files import SAID, laid_room, write_plan


def test_a_scene_that_is_not_here_leaves_the_rest_on_show(server: viser.ViserServer) -> None:
    def load(name: str, _state: WorldState) -> bytes:
        if name == "foreign":
            raise SceneError("no such scene")
        return b"glTF"

    layer = SceneLayer(server.scene, load)
    layer.show(Snapshot(scene="here"))
    layer.show(Snapshot(scene="foreign"))
    assert layer.handle is not None
    assert not layer.handle.visible
    layer.show(Snapshot(scene="here"))
    assert layer.handle.visible


def test_a_changed_scene_stays_until_a_page_had_time_for_the_new_one(server: viser.ViserServer) -> None:
    now = [0.0]
    layer = SceneLayer(server.scene, lambda _name, _state: b"glTF", clock=lambda: now[0])

    def show(scene: str, *missing: str) -> viser.GlbHandle:
        progress = NavigationProgress(world=replace(AS_MADE, missing=frozenset(missing)))
        layer.show(Snapshot(scene=scene, moment=replace(RunMoment(), progress=progress)))
        assert layer.handle is not None
        return layer.handle

    whole = show("here")
    emptier = show("here", "table")
    assert emptier.name != whole.name
    assert not whole._impl.removed
    now[0] += LINGER_S
    assert show("here", "table") is emptier
    assert whole._impl.removed
    show("elsewhere")
    assert emptier._impl.removed


FOV = float(np.radians(75))


@pytest.mark.parametrize("high", [(6.0, 4.0), (-1.0, 30.0), (40.0, -0.5), (1.0, 0.0)])
def test_the_first_view_holds_the_whole_floor_with_its_walls_and_wastes_little(high: tuple[float, float]) -> None:
    low = (-2.0, -3.0)
    camera = SimpleNamespace(fov=FOV)
    Floor(low, high).begin(cast("Any", SimpleNamespace(initial_camera=camera)))
    position, look_at = np.array(camera.position), np.array(camera.look_at)
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(ahead, (0, 0, 1)) / np.linalg.norm(np.cross(ahead, (0, 0, 1)))
    corners = np.array(list(product((low[0], high[0]), (low[1], high[1]), (0.0, CUT_HEIGHT_M)))) - position
    seen = np.column_stack([corners @ right / USUAL_ASPECT, corners @ np.cross(right, ahead)])
    seen /= (corners @ ahead * np.tan(FOV / 2))[:, None]

    assert np.abs(seen).max() < 1
    assert np.ptp(seen, axis=0).max() / 2 > 0.6


def test_the_wall_of_a_turned_plan_is_drawn_where_the_plan_has_it(tmp_path: Path) -> None:
    plan = FloorPlan.open(write_plan(tmp_path, SAID.replace("2.0, 0]", "2.0, 0.4]"))).moved(np.array([4.0, 1.0, 2.0]))
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        drawn = draw_floor_plan(server.scene, plan)
        # viser's pictures are looked at along z: x goes to the right, y down, from the middle.
        wall = np.array([-drawn.render_width / 2 + 0.25, -drawn.render_height / 2 + 0.25, 0.0])
        place = Rotation.from_quat(drawn.wxyz, scalar_first=True).apply(wall) + drawn.position
    finally:
        server.stop()
    assert (drawn.render_width, drawn.render_height) == (3.0, 2.0)
    assert plan.cells_at([place[:2]]).tolist() == [100]
    assert 0 < place[2] < 0.01


def test_the_plan_moves_with_its_points() -> None:
    laid = laid_room()
    moved = laid.moved_to(np.array([2.0, 1.0, 0.5])).plan
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        layer = FloorPlanLayer(server.scene)
        layer.show(Snapshot())
        assert layer.image is None
        layer.show(Snapshot(floor_plan=FloorPlanView(laid.plan)))
        image = layer.image
        layer.show(Snapshot(floor_plan=FloorPlanView(moved, is_aligning=True, node=3, marks=((1.0, 2.0),))))
        assert image is layer.image
        assert image is not None
        np.testing.assert_allclose(image.position[:2], moved.middle[:2])
    finally:
        server.stop()
