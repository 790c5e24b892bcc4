"""The scene itself, against a real viser server without a browser: what stays drawn when it is another one."""

from dataclasses import replace

import viser

from ltvn_core.errors import SceneError
from ltvn_core.navigation.event_table import NavigationProgress
from ltvn_core.worlds import AS_MADE, WorldState
from ltvn_viz.layers.scene_layer import LINGER_S, SceneLayer
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.timeline.run_moment import RunMoment


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
