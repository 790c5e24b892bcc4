"""A map opens by its path as well as by its contents, and what is no path is refused with what would be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.exporting.recording_export import ExportFormat, export_recording
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import DriveError, RecordingError, WeightsError
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.recorded_map import BuildOptions, build_recorded_map, save_recorded_map
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, one_room, tour
from tests.repository import DEMO_MAP


def test_a_map_opens_by_its_path_as_by_its_contents() -> None:
    by_contents = TopologicalMap.open(load_map(DEMO_MAP), with_reserve=False)
    by_path = TopologicalMap.open(str(DEMO_MAP), with_reserve=False)
    assert by_path.graph.nodes == by_contents.graph.nodes
    assert by_path.graph.edges == by_contents.graph.edges
    assert by_path.predictor_name == by_contents.predictor_name


@pytest.mark.parametrize("given", [None, 3, b"map.rrd", ["map.rrd"]])
def test_what_is_no_path_is_refused_wherever_a_recording_is_named(given: object) -> None:
    built = build_map(tour([(0.7, 0.7), (1.4, 0.7)], spins=False), predictor=FlatPredictor(one_room()))
    for use in (Recording.open, load_map, TopologicalMap.load, TopologicalMap.open, built.save):
        with pytest.raises(RecordingError, match=r"path .*map\.rrd"):
            use(given)  # type: ignore[arg-type]


def short_drive() -> list[Observation]:
    """Return a few images with colours, which any predictor can compare."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (72, 96, 3), np.uint8)
    return [replace(seen, rgb=picture) for seen in tour([(0.7, 0.7), (1.2, 0.7)], spins=False)]


@pytest.mark.parametrize("name", ["network", "geometric"])
def test_a_map_names_the_predictor_that_was_opened_by_name(tmp_path: Path, name: str) -> None:
    predictor = open_predictor(name)
    built = build_map(short_drive(), predictor=predictor)
    built.save(tmp_path / "map.rrd")
    again = TopologicalMap.load(tmp_path / "map.rrd")
    assert again.predictor.fingerprint == predictor.fingerprint
    assert type(again.predictor) is type(predictor)


def test_weights_recordings_and_outputs_are_named_by_text_as_by_path(tmp_path: Path) -> None:
    weights = str(SHIPPED_WEIGHTS)
    assert load_predictor(weights).fingerprint == open_predictor("network", weights=weights).fingerprint
    assert TopologicalMap.open(str(DEMO_MAP), weights=weights, with_reserve=False).graph.nodes
    with RecordingWriter(str(tmp_path / "drive.rrd"), scene="flat", config={}, fingerprint="") as writer:
        for seen in short_drive():
            writer.write_frame(seen)
    built = build_recorded_map(str(tmp_path / "drive.rrd"), BuildOptions(), answers=str(tmp_path / "answers"))
    built.map.save(str(tmp_path / "copy.rrd"), origin=str(tmp_path / "drive.rrd"))
    save_recorded_map(built.map, str(tmp_path / "map.rrd"), BuildOptions())
    recording = Recording.open(str(tmp_path / "map.rrd"))
    export_recording(recording, str(tmp_path / "map.graphml"), ExportFormat.GRAPHML)
    assert (tmp_path / "map.graphml").exists()
    with pytest.raises(DriveError):
        open_drive(str(tmp_path / "nothing"))
    with pytest.raises(WeightsError, match="card"):
        open_predictor("onnx", weights=str(tmp_path / "card.toml"))
