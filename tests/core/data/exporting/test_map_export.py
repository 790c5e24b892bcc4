"""A map in another program's format is read by that program's library, with all that is believed of its edges."""

import json
from pathlib import Path

import networkx
import numpy as np
import pytest

from ltvn_core.data.exporting.map_files import placed_map
from ltvn_core.data.exporting.recording_export import ExportFormat, export_recording
from ltvn_core.data.recording.reader import Recording
from ltvn_core.geometry import compose
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


def test_a_route_graph_can_be_written_in_the_frame_of_a_floor_plan(tmp_path: Path, recording: Recording) -> None:
    frame = np.array([5.0, -2.0, 0.7])
    written = {}
    for name, pose in (("own", None), ("plan", frame)):
        export_recording(recording, tmp_path / name, ExportFormat.NAV2_ROUTE, frame=pose)
        written[name] = json.loads((tmp_path / name).read_text(encoding="utf-8"))["features"]
    nodes = [each for each in written["plan"] if each["geometry"]["type"] == "Point"]
    poses = np.array([(*each["geometry"]["coordinates"], each["properties"]["metadata"]["yaw"]) for each in nodes])

    back = compose(frame, poses)

    placed = placed_map(recording).poses
    np.testing.assert_allclose(back, [placed[each["properties"]["id"]] for each in nodes], atol=1e-9)
    edges, same = (
        [each["properties"] for each in written[name] if each["geometry"]["type"] != "Point"]
        for name in ("plan", "own")
    )
    assert edges == same
