"""A map opens by its path as well as by its contents, and what is no path is refused with what would be."""

from collections.abc import Callable
from pathlib import Path

import pytest

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import RecordingError
from ltvn_core.maps.topological_map import TopologicalMap, build_map
from tests.core.flat_world import FlatPredictor, one_room, tour
from tests.repository import DEMO_MAP


@pytest.mark.parametrize("kind", [Path, str])
def test_a_map_opens_by_its_path_as_by_its_contents(kind: Callable[[Path], Path | str]) -> None:
    by_contents = TopologicalMap.open(load_map(DEMO_MAP), with_reserve=False)
    by_path = TopologicalMap.open(kind(DEMO_MAP), with_reserve=False)
    assert by_path.graph.nodes == by_contents.graph.nodes
    assert by_path.graph.edges == by_contents.graph.edges
    assert by_path.predictor_name == by_contents.predictor_name


@pytest.mark.parametrize("given", [None, 3, b"map.rrd", ["map.rrd"]])
def test_what_is_no_path_is_refused_wherever_a_recording_is_named(given: object) -> None:
    built = build_map(tour([(0.7, 0.7), (1.4, 0.7)], spins=False), predictor=FlatPredictor(one_room()))
    for use in (Recording.open, load_map, TopologicalMap.load, TopologicalMap.open, built.save):
        with pytest.raises(RecordingError, match=r"path .*map\.rrd"):
            use(given)  # type: ignore[arg-type]
