"""A floor plan under the map, on a real viser server without a browser: every pixel and click is where it belongs."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

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


def test_the_plan_moves_and_takes_clicks_only_while_a_place_on_it_is_expected() -> None:
    places: list[tuple[float, float]] = []
    laid = laid_room()
    moved = laid.moved_to(np.array([2.0, 1.0, 0.5])).plan
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        layer = FloorPlanLayer(server.scene, on_place=places.append)
        layer.show(Snapshot())
        assert layer.image is None
        layer.show(Snapshot(floor_plan=FloorPlanView(laid.plan)))
        image = layer.image
        assert layer.sheet is None
        layer.show(Snapshot(floor_plan=FloorPlanView(moved, is_aligning=True, node=3, marks=((1.0, 2.0),))))
        assert image is layer.image
        assert image is not None
        np.testing.assert_allclose(image.position[:2], moved.middle[:2])
        assert layer.sheet is not None
        np.testing.assert_allclose(layer.sheet.position[:2], moved.middle[:2])
        assert layer.marks.handle.visible
        # In a thread of its own: after a browser test, pytest's thread already runs Playwright's event loop.
        with ThreadPoolExecutor(1) as thread:
            for up in (-1.0, 1.0):
                thread.submit(asyncio.run, layer._clicked(_ray((1.0, 0.0, 5.005), (0.2, 0.4, up)))).result()
        layer.show(Snapshot(floor_plan=FloorPlanView(moved)))
        assert layer.sheet is None
    finally:
        server.stop()
    np.testing.assert_allclose(places, [(2.0, 2.0)])


def _ray(origin: tuple[float, float, float], along: tuple[float, float, float]) -> viser.SceneNodePointerEvent[Any]:
    """Return a click, as far as a layer reads it."""
    return viser.SceneNodePointerEvent(
        client=cast(Any, None),
        client_id=1,
        event="click",
        target=cast(Any, None),
        ray_origin=origin,
        ray_direction=along,
        screen_pos=(0.5, 0.5),
        instance_index=None,
        modifier=None,
    )
