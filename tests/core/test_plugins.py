"""Plug-ins of all kinds are found by name, ours first, and a broken one spoils no other."""

import logging
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from ltvn_core.errors import MissingLibraryError, PluginError
from ltvn_core.plugins import GROUPS, OWN_PACKAGE, PREDICTORS, ROBOTS, Plugin, find_plugins, load_plugins, require_own
from tests.core.plugin_packages import install


def named(value: str) -> Plugin:
    return Plugin(ROBOTS, EntryPoint("mine", value, ROBOTS.name))


def test_a_plug_in_says_whose_it_is_and_is_imported_only_when_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "turtles", "[ltvn.robots]\nslow = turtles:make\n", source="def make(): ...", version="2.1")
    monkeypatch.syspath_prepend(str(tmp_path))

    found = find_plugins(ROBOTS)["slow"]

    assert (found.package, found.version, found.place) == ("turtles", "2.1", "turtles:make")
    assert "turtles" not in sys.modules
    assert callable(found.load())


def test_a_package_whose_list_is_no_list_is_named_and_keeps_no_other_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    install(tmp_path, "torn", "[ltvn.robots]\nthis is no entry point\n")
    install(tmp_path, "turtles", "[ltvn.robots]\nslow = turtles:make\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    with caplog.at_level(logging.WARNING):
        robots = find_plugins(ROBOTS)

    assert "slow" in robots
    assert "The plug-ins of the package torn cannot be read" in caplog.text
    assert any(plugin.package == OWN_PACKAGE for group in GROUPS for plugin in find_plugins(group).values())


def test_of_two_packages_with_one_name_the_first_by_name_stands_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "zebras", "[ltvn.robots]\nslow = zebras:make\n")
    install(tmp_path, "ants", "[ltvn.robots]\nslow = ants:make\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert find_plugins(ROBOTS)["slow"].package == "ants"


def test_names_that_are_to_come_first_do_and_the_others_follow_by_name() -> None:
    entries = [EntryPoint(name, "a:b", PREDICTORS.name) for name in ("zeal", "network", "art")]
    assert [*find_plugins(PREDICTORS, first=("network", "gone"), entries=entries)] == ["network", "art", "zeal"]


def test_a_module_that_ends_python_while_it_is_imported_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "leaving.py").write_text("raise SystemExit(3)", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))

    loaded = load_plugins({"away": named("leaving:make"), "here": named("math:sqrt")}, Plugin.load)

    assert [*loaded.by_name] == ["here"]
    assert loaded.broken == [
        "The robot mine cannot be loaded (SystemExit: 3); update, repair or uninstall that package."
    ]


def test_a_library_that_an_extra_brings_is_named_with_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wanting.py").write_text("raise ModuleNotFoundError('no', name='torch')", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingLibraryError, match=r"ltvn\[network\]"):
        named("wanting:make").load()


def test_one_of_ours_that_was_never_installed_says_to_install_the_toolkit_again() -> None:
    require_own(PREDICTORS, "mine", ("network",))
    with pytest.raises(PluginError, match=r"predictor network of the toolkit itself is not installed.*pip install -e"):
        require_own(PREDICTORS, "network", ("network",))


def test_what_is_missing_in_a_module_is_said_with_its_name() -> None:
    with pytest.raises(PluginError, match=r"The robot mine cannot be loaded \(AttributeError.*no_such_thing"):
        named("math:no_such_thing").load()
