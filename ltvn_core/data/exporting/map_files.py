"""Writes a map for other programs: GraphML, GeoJSON, and the graph of Nav2's Route Server.

Nodes are at their true poses if these are known, otherwise at their odometry poses, which drift. They can also be
written in another frame, such as that of a floor plan. All lengths are metres in a plane, not degrees on the globe.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self
from xml.etree import ElementTree

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose

MAP_FRAME = "map"
_GRAPHML_KINDS = {bool: "boolean", int: "long", float: "double", str: "string"}


class PlacedMap(NamedTuple):
    """A map and the poses of its nodes."""

    graph: TopologicalGraph
    poses: dict[NodeId, Pose]
    """(3,) of each node."""

    def seen_from(self, frame: Pose) -> Self:
        """Return the map in another frame, whose pose (3,) in the map's frame is given."""
        return self._replace(poses={node: relative(frame, pose) for node, pose in self.poses.items()})


def placed_map(recording: Recording) -> PlacedMap:
    """Return the map at the end of a recording. Raises MapError if it has none."""
    graph = recording.final_graph()
    if not graph.nodes:
        raise MapError(f"{recording.path} holds no map; run `ltvn build {recording.path}` to make one.")
    known = recording.poses
    drawn = known.odometry if known.exact is None else known.exact
    frames = {int(step): pose for step, pose in zip(known.steps, drawn, strict=True)}
    return PlacedMap(graph, {node: frames.get(node, _odometry(graph, node)) for node in graph.nodes})


def write_graphml(placed: PlacedMap, path: Path) -> None:
    """Write a directed graph with x, y, yaw of each node, and waypoint and belief of each edge."""
    # rustworkx is not used here, because its writer mixes up the types of attributes.
    root = ElementTree.Element("graphml", xmlns="http://graphml.graphdrawing.org/xmlns")
    graph = ElementTree.Element("graph", edgedefault="directed")
    for node, pose in placed.poses.items():
        x, y, yaw = map(float, pose)
        said = placed.graph.nodes[node]
        element = ElementTree.SubElement(graph, "node", id=str(node))
        _add_data(root, element, {"x": x, "y": y, "yaw": yaw, "name": said.name, "goal": said.goal})
    for edge in placed.graph.edges.values():
        element = ElementTree.SubElement(graph, "edge", source=str(edge.source), target=str(edge.target))
        _add_data(root, element, _said_of(edge))
    root.append(graph)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def write_geojson(placed: PlacedMap, path: Path) -> None:
    """Write nodes as points and edges as lines, with the waypoint, belief and attempts of each edge."""
    features = [
        _feature("Point", _point(pose), {"id": node, "yaw_rad": float(pose[2]), "name": placed.graph.nodes[node].name})
        for node, pose in placed.poses.items()
    ]
    features += [
        _feature("LineString", line, {"source": edge.source, "target": edge.target, **_said_of(edge)})
        for edge, line in _lines(placed)
    ]
    _write(path, features)


def write_nav2_route(placed: PlacedMap, path: Path) -> None:
    """Write GeoJSON for Nav2's Route Server, in which every node and every directed edge has a unique integer as its
    id.

    Raises MapError for a map without edges, which the server refuses.
    """
    if not placed.graph.edges:
        raise MapError("A map without edges is not a route graph for Nav2; build one from a longer drive.")
    features = [
        _feature("Point", _point(pose), {"id": node, "frame": MAP_FRAME, "metadata": {"yaw": float(pose[2])}})
        for node, pose in placed.poses.items()
    ]
    first = max(placed.poses) + 1
    for number, (edge, line) in enumerate(_lines(placed), start=first):
        properties = {
            "id": number,
            "startid": edge.source,
            "endid": edge.target,
            "cost": float(edge.belief.mu),
            "overridable": True,
            "metadata": {"probability": float(edge.belief.p), "attempts": edge.attempts, "action": edge.action},
        }
        features.append(_feature("MultiLineString", [line], properties))
    _write(path, features)


def _add_data(root: ElementTree.Element, element: ElementTree.Element, values: Mapping[str, Any]) -> None:
    """Write the attributes of a node or an edge, and declare the type of each attribute once."""
    for name, value in values.items():
        key = f"{element.tag}_{name}"
        if root.find(f"key[@id='{key}']") is None:
            said = {"id": key, "for": element.tag, "attr.name": name, "attr.type": _GRAPHML_KINDS[type(value)]}
            ElementTree.SubElement(root, "key", said)
        text = str(value).lower() if isinstance(value, bool) else str(value)
        ElementTree.SubElement(element, "data", key=key).text = text


def _odometry(graph: TopologicalGraph, node: NodeId) -> Any:
    row = graph.nodes[node].odometry
    return row.x_m, row.y_m, row.yaw_rad


def _said_of(edge: Edge) -> dict[str, float | int | str]:
    return {
        "dx_m": float(edge.waypoint.x_m),
        "dy_m": float(edge.waypoint.y_m),
        "dtheta_rad": float(edge.waypoint.yaw_rad),
        "p": float(edge.belief.p),
        "mu": float(edge.belief.mu),
        "sigma2": float(edge.belief.sigma2),
        "attempts": edge.attempts,
        "successes": edge.successes,
        "action": edge.action,
    }


def _lines(placed: PlacedMap) -> Iterator[tuple[Edge, list[list[float]]]]:
    for edge in placed.graph.edges.values():
        yield edge, [_point(placed.poses[edge.source]), _point(placed.poses[edge.target])]


def _point(pose: Pose) -> list[float]:
    return [float(pose[0]), float(pose[1])]


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _write(path: Path, features: list[dict[str, Any]]) -> None:
    collection = {"type": "FeatureCollection", "frame": MAP_FRAME, "unit": "metre", "features": features}
    path.write_text(json.dumps(collection, allow_nan=False), encoding="utf-8")
