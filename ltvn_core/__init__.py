"""Lifelong topological visual navigation: record, map, navigate, and find out why.

    import ltvn_core as ltvn

    recording = ltvn.Recording.open("drive.rrd")
    observations = [recording.observation(frame) for frame in recording.frames]
    topological_map = ltvn.build_map(observations)

Everything in `__all__` is the public API. A name is imported when it is first used, so that `import ltvn_core` takes no
time and needs neither the network nor the simulator.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ltvn_core import analysis as analysis
    from ltvn_core.analysis.timeline import Timeline as Timeline
    from ltvn_core.cameras.camera_model import CameraModel as CameraModel
    from ltvn_core.config import PAPER as PAPER
    from ltvn_core.config import ROBUST as ROBUST
    from ltvn_core.config import Method as Method
    from ltvn_core.config import preset as preset
    from ltvn_core.data.recording.reader import Recording as Recording
    from ltvn_core.data.recording.writer import RecordingWriter as RecordingWriter
    from ltvn_core.errors import LtvnError as LtvnError
    from ltvn_core.geometry import compose as compose
    from ltvn_core.geometry import relative as relative
    from ltvn_core.graph.deltas import Belief as Belief
    from ltvn_core.graph.navigation_system import NavigationSystem as NavigationSystem
    from ltvn_core.graph.topological_graph import TopologicalGraph as TopologicalGraph
    from ltvn_core.maps.built_map import build_map as build_map
    from ltvn_core.maps.topological_map import TopologicalMap as TopologicalMap
    from ltvn_core.navigation.events import QueryEnded as QueryEnded
    from ltvn_core.navigation.events import Tick as Tick
    from ltvn_core.navigation.navigator import Navigator as Navigator
    from ltvn_core.predictors.opening import open_predictor as open_predictor
    from ltvn_core.predictors.request import PredictorRequest as PredictorRequest
    from ltvn_core.preprocessing import preprocess_observation as preprocess_observation
    from ltvn_core.robots.drive_lease import DriveLease as DriveLease
    from ltvn_core.robots.robot import Robot as Robot
    from ltvn_core.robots.robot import WallClock as WallClock
    from ltvn_core.robots.robot_spec import LOCOBOT as LOCOBOT
    from ltvn_core.robots.robot_spec import RobotSpec as RobotSpec
    from ltvn_core.simulation.opening import open_simulation as open_simulation
    from ltvn_core.systems.registry import open_system as open_system
    from ltvn_core.types import Observation as Observation
    from ltvn_core.types import Prediction as Prediction
    from ltvn_core.types import Predictor as Predictor
    from ltvn_core.types import RobotState as RobotState
    from ltvn_core.types import Twist as Twist

_HOMES = {
    "Belief": "graph.deltas",
    "CameraModel": "cameras.camera_model",
    "DriveLease": "robots.drive_lease",
    "LOCOBOT": "robots.robot_spec",
    "LtvnError": "errors",
    "Method": "config",
    "NavigationSystem": "graph.navigation_system",
    "Navigator": "navigation.navigator",
    "Observation": "types",
    "PAPER": "config",
    "Prediction": "types",
    "Predictor": "types",
    "PredictorRequest": "predictors.request",
    "QueryEnded": "navigation.events",
    "ROBUST": "config",
    "Recording": "data.recording.reader",
    "RecordingWriter": "data.recording.writer",
    "Robot": "robots.robot",
    "RobotSpec": "robots.robot_spec",
    "RobotState": "types",
    "Tick": "navigation.events",
    "Timeline": "analysis.timeline",
    "TopologicalGraph": "graph.topological_graph",
    "TopologicalMap": "maps.topological_map",
    "Twist": "types",
    "WallClock": "robots.robot",
    "build_map": "maps.built_map",
    "compose": "geometry",
    "open_predictor": "predictors.opening",
    "open_simulation": "simulation.opening",
    "open_system": "systems.registry",
    "preprocess_observation": "preprocessing",
    "preset": "config",
    "relative": "geometry",
}
"""Module of each public name, relative to this package."""

__all__ = [
    "LOCOBOT",
    "PAPER",
    "ROBUST",
    "Belief",
    "CameraModel",
    "DriveLease",
    "LtvnError",
    "Method",
    "NavigationSystem",
    "Navigator",
    "Observation",
    "Prediction",
    "Predictor",
    "PredictorRequest",
    "QueryEnded",
    "Recording",
    "RecordingWriter",
    "Robot",
    "RobotSpec",
    "RobotState",
    "Tick",
    "Timeline",
    "TopologicalGraph",
    "TopologicalMap",
    "Twist",
    "WallClock",
    "__version__",
    "analysis",
    "build_map",
    "compose",
    "open_predictor",
    "open_simulation",
    "open_system",
    "preprocess_observation",
    "preset",
    "relative",
]

try:
    __version__ = version("ltvn")
except PackageNotFoundError:  # The package runs from a folder, without being installed.
    __version__ = "0+unknown"


def __getattr__(name: str) -> object:
    """Import a public name at its first use. Raises AttributeError for any other name."""
    if name == "analysis":
        return import_module("ltvn_core.analysis")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; see ltvn_core.__all__ for its names")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
