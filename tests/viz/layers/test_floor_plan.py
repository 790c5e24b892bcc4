"""A floor plan under the map, on a real viser server without a browser: every pixel is where it belongs."""

from pathlib import Path

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_viz.layers.floor_plan import FloorPlanLayer, draw_floor_plan
from ltvn_viz.session.snapshot import FloorPlanView, Snapshot
from tests.core.data.importing.plan_files import SAID, laid_room, write_plan


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
