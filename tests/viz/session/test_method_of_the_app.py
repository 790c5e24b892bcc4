"""The page opens with the navigation system that the command line names, unless a map brings its own."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_core.errors import OptionError
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.goals import ThumbnailStore
from ltvn_viz.session.options import AppOptions
from tests.repository import DEMO_MAP

pytest.importorskip("embreex")


@pytest.mark.parametrize("system", ["sorb", "meng"])  # Of which one has weights of its own.
def test_a_rival_begins_with_an_empty_map_since_the_ready_made_one_is_not_its_own(system: str, tmp_path: Path) -> None:
    steps: list[str] = []
    with ExitStack() as stack:
        state = open_app_state(AppOptions(recordings=tmp_path, system=system), stack, ThumbnailStore(), steps.append)
        assert any("simulator" in step for step in steps)
        assert state.live_map.system.name == system
        assert not state.live_map.graph.nodes


def test_a_map_of_another_system_is_refused(tmp_path: Path) -> None:
    options = AppOptions(recordings=tmp_path, system="sorb", map=DEMO_MAP)
    with ExitStack() as stack, pytest.raises(OptionError, match=r"--system sorb contradicts --map, which ltvn built"):
        open_app_state(options, stack, ThumbnailStore())
