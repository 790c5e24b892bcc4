"""A scene of another package is found by its name, as ours are, and recordings can find it again."""

from pathlib import Path

import pytest

from ltvn_core.errors import PluginError
from ltvn_core.plugins import SCENES, find_plugins
from ltvn_core.simulation.scene_registry import load_scene, scene_names
from ltvn_core.verbs.jobs.plugins import contract_checks
from tests.core.plugin_packages import install
from tests.core.simulation.two_room_mesh import box_house, save


def test_a_scene_of_another_package_is_found_by_its_name_and_keeps_the_contract(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "from pathlib import Path\ndef two_rooms(): return Path(__file__).with_name('house.glb')\n"
    save(box_house(), tmp_path / "house.glb")
    install(tmp_path, "two_houses", "[ltvn.scenes]\ntwo-rooms = two_houses:two_rooms\n", source=source)
    monkeypatch.syspath_prepend(str(tmp_path))

    assert scene_names()[-1] == "two-rooms"
    assert (load_scene("two-rooms").name, load_scene("two-rooms").address) == ("two-rooms", "two-rooms")
    assert [each for each in contract_checks(find_plugins(SCENES)["two-rooms"]) if not each.passed] == []


def test_a_broken_scene_is_refused_with_the_name_of_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "def nothing(): return 7\n"
    install(tmp_path, "empty_houses", "[ltvn.scenes]\nnothing = empty_houses:nothing\n", source=source)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PluginError, match=r"scene nothing of the package empty_houses .*returns int, not a Scene"):
        load_scene("nothing")
