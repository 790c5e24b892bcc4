"""A map in another program's format is read by that program's library, with all that is believed of its edges."""

import json
from pathlib import Path

import networkx
import pytest

from ltvn_core.data.exporting.recording_export import ExportFormat, export_recording
from ltvn_core.data.recording.reader import Recording
from tests.repository import DEMO_MAP


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording.open(DEMO_MAP)


def test_graphml_is_read_by_networkx(tmp_path: Path, recording: Recording) -> None:
    done = export_recording(recording, tmp_path / "map.graphml", ExportFormat.GRAPHML)

    graph = networkx.read_graphml(tmp_path / "map.graphml")
    ours = recording.final_graph()

    assert graph.is_directed()
    assert (graph.number_of_nodes(), graph.number_of_edges()) == (done.nodes, done.edges)
    assert (done.nodes, done.edges) == (len(ours.nodes), len(ours.edges))
    edge = next(iter(ours.edges.values()))
    assert set(graph.nodes) == {str(node) for node in ours.nodes}
    assert graph.edges[str(edge.source), str(edge.target)]["p"] == pytest.approx(edge.belief.p)
    assert graph.edges[str(edge.source), str(edge.target)]["dx_m"] == pytest.approx(edge.waypoint.x_m)


def test_geojson_has_nodes_as_points_and_edges_as_lines_between_them(tmp_path: Path, recording: Recording) -> None:
    export_recording(recording, tmp_path / "map.geojson", ExportFormat.GEOJSON)

    collection = json.loads((tmp_path / "map.geojson").read_text(encoding="utf-8"))
    features = collection["features"]
    points = {
        each["properties"]["id"]: each["geometry"]["coordinates"]
        for each in features
        if each["geometry"]["type"] == "Point"
    }
    lines = [each for each in features if each["geometry"]["type"] == "LineString"]

    assert collection["type"] == "FeatureCollection"
    assert len(points) + len(lines) == len(features)
    for line in lines:
        said = line["properties"]
        assert line["geometry"]["coordinates"] == [points[said["source"]], points[said["target"]]]


def test_a_route_graph_has_what_the_route_server_reads(tmp_path: Path, recording: Recording) -> None:
    """As nav2_route's own loader takes it: unsigned ids, and edges between nodes that exist."""
    export_recording(recording, tmp_path / "route.geojson", ExportFormat.NAV2_ROUTE)

    features = json.loads((tmp_path / "route.geojson").read_text(encoding="utf-8"))["features"]
    nodes = [each["properties"] for each in features if each["geometry"]["type"] == "Point"]
    edges = [each["properties"] for each in features if each["geometry"]["type"] == "MultiLineString"]
    ids = [each["id"] for each in (*nodes, *edges)]

    assert len(nodes) + len(edges) == len(features)
    assert len(set(ids)) == len(ids)
    assert all(isinstance(number, int) and number >= 0 for number in ids)
    known = {node["id"] for node in nodes}
    assert all({edge["startid"], edge["endid"]} <= known for edge in edges)
    assert all(node["frame"] == "map" for node in nodes)
    assert len(edges) == len(recording.final_graph().edges)
