"""The contract of each kind of plug-in, and the checks of a plug-in without running it.

Owns three contracts. A reader must recognise its own format and reject all other files. A robot must have all parts,
valid images and an increasing clock; it is not driven. A system must build valid maps, and the same map from the same
images. Predictors and scenes have contracts in modules of their own.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.errors import LtvnError
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.plugins import GROUPS, PREDICTORS, READERS, ROBOTS, SCENES, SYSTEMS, Plugin, PluginGroup, find_plugins
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.opening import OWN_PREDICTORS
from ltvn_core.predictors.request import predictor_card
from ltvn_core.preprocessing import admit_observation
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_plugins import open_robot
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.registry import OWN_SYSTEMS, load_system
from ltvn_core.types import Predictor
from ltvn_core.verbs.contracts.predictor_contract import (
    ContractCheck,
    SampleImages,
    predictor_checks,
    require,
    run_checks,
    sample_images,
)

POSES = 10


def scene_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Open a scene and find a free place."""
    return run_checks(
        ("opens by its name", lambda: _opens(plugin)),
        [
            ("has free floor", lambda: _has_floor(plugin)),
            ("has visible surfaces", lambda: _has_surfaces(plugin)),
        ],
    )


def _opens(plugin: Plugin) -> str:
    scene = load_scene(plugin.name)
    require(scene.address == plugin.name, f"its address is {scene.address!r}, which does not open it again")
    return f"{scene.area_m2:.0f} m2"


def _has_floor(plugin: Plugin) -> str:
    clearance = load_scene(plugin.name).clearance
    poses = clearance.sample_poses(np.random.default_rng(0), POSES)
    require(bool(np.all(clearance.at(poses[:, :2]) > 0)), "free places lie within obstacles")
    return f"{clearance.navigable.sum() * clearance.resolution_m**2:.0f} m2 to drive on"


def _has_surfaces(plugin: Plugin) -> str:
    surfaces = load_scene(plugin.name).surfaces
    require(len(surfaces.faces) > 0, "it has no triangles")
    require(int(surfaces.faces.max()) < len(surfaces.vertices), "faces refer to missing vertices")
    require(int(surfaces.face_texture.max()) < len(surfaces.textures), "faces refer to missing textures")
    return f"{len(surfaces.faces):,} triangles"


IMAGES = 12
PARTS = ("build", "edge_weight", "localise", "subgoal")
LOOKS = 3
_FIRST: Mapping[PluginGroup, tuple[str, ...]] = {PREDICTORS: OWN_PREDICTORS, SYSTEMS: OWN_SYSTEMS}


def system_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Create a navigation system and let it build a small map."""
    contract = SystemContract(plugin, sample_images(IMAGES))
    return run_checks(
        ("is made with the thresholds of a method", contract.is_made),
        [
            ("builds a map of the images that it is given", contract.builds),
            ("builds the same map again", contract.is_deterministic),
            ("weighs edges by finite numbers of at least 0", contract.weighs_edges),
        ],
    )


@dataclass(frozen=True)
class SystemContract:
    """The contract of a navigation system, with the sample images for the test."""

    plugin: Plugin
    samples: SampleImages

    @cached_property
    def system(self) -> NavigationSystem:
        """The system, with the robust preset."""
        return load_system(self.plugin).factory(ROBUST)

    @cached_property
    def predictor(self) -> Predictor:
        """A predictor that needs neither weights nor a simulator."""
        return GeometricPredictor(self.samples.meta.camera)

    @cached_property
    def deltas(self) -> Deltas:
        """The deltas of the map that the system builds."""
        return self._build()

    def is_made(self) -> str:
        """Check that the system has all parts."""
        require(
            isinstance(self.system, NavigationSystem),
            f"its factory must return a NavigationSystem, got {type(self.system).__name__}",
        )
        missing = [part for part in PARTS if not callable(getattr(self.system, part))]
        require(not missing, f"these parts cannot be called: {', '.join(missing)}")
        return self.system.name

    def builds(self) -> str:
        """Check that the deltas make a valid map."""
        graph = TopologicalGraph(self.deltas)
        given = {seen.step for seen in self.samples.observations}
        require(bool(graph.nodes), "its map has no node")
        require({*graph.nodes, *graph.reserve} <= given, "its map has nodes that are not images of the drive")
        return f"{len(graph.nodes)} nodes, {len(graph.edges)} edges of {IMAGES} images"

    def is_deterministic(self) -> str:
        """Check that a second build with the same random numbers gives the same map."""
        require(self._build() == self.deltas, "the second map differs; draw random numbers only from `rng`")
        return ""

    def weighs_edges(self) -> str:
        """Check the cost of each edge of the map."""
        costs = [self.system.edge_weight(edge.belief) for edge in TopologicalGraph(self.deltas).edges.values()]
        require(all(np.isfinite(cost) and cost >= 0 for cost in costs), f"got {costs[:3]}")
        return f"from {min(costs):.2f} to {max(costs):.2f}" if costs else "its map has no edge"

    def _build(self) -> Deltas:
        assert predictor_card(self.predictor).camera == self.samples.meta.camera
        keyframes = KeyframeStore(self.predictor)
        rng = np.random.default_rng(0)
        return tuple(self.system.build(self.samples.observations, keyframes, self.predictor, rng=rng))


def reader_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Check that a reader rejects files in other formats."""
    return run_checks(
        ("recognises and opens a drive", lambda: _has_parts(plugin)),
        [("does not recognise an empty folder", lambda: _recognises_nothing(plugin))],
    )


def _has_parts(plugin: Plugin) -> str:
    reader = plugin.load()
    missing = [name for name in ("recognises", "open") if not callable(getattr(reader, name, None))]
    require(not missing, f"it lacks the class methods {' and '.join(missing)}")
    return ""


def _recognises_nothing(plugin: Plugin) -> str:
    reader: Any = plugin.load()
    with tempfile.TemporaryDirectory(prefix="ltvn-") as name:
        folder = Path(name)
        (folder / "empty").mkdir()
        (folder / "noise.bin").write_bytes(bytes(range(256)) * 16)
        (folder / "nothing.txt").write_bytes(b"")
        for place in ("empty", "noise.bin", "nothing.txt", "not-there"):
            require(reader.recognises(folder / place) is False, f"it claims to recognise {place}")
    return ""


def robot_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Create a robot and check its images; it is not driven."""
    contract = RobotContract(plugin)
    return run_checks(
        ("is created, and returns a first image", contract.is_made),
        [
            ("returns images that fit its camera", contract.takes_images),
            ("has increasing steps and times", contract.counts_upwards),
            ("stops at `stop()`", contract.stops),
        ],
    )


@dataclass(frozen=True)
class RobotContract:
    """The contract of a robot that stands still."""

    plugin: Plugin

    @cached_property
    def robot(self) -> Robot:
        """The robot itself."""
        return open_robot(self.plugin.name, {self.plugin.name: self.plugin})

    def is_made(self) -> str:
        """Check that the robot has all parts, as `ltvn app --robot` does."""
        camera = self.robot.spec.camera
        return f"{self.robot.spec.name}, camera {camera.width} x {camera.height}"

    def takes_images(self) -> str:
        """Check a few images."""
        camera = self.robot.spec.camera
        seen = [admit_observation(self.robot.observe(), camera, camera, source=self.plugin.name) for _ in range(LOOKS)]
        return f"{sum(each.has_depth for each in seen)} of {LOOKS} with depth"

    def counts_upwards(self) -> str:
        """Check that step and time never decrease."""
        states = [self.robot.state() for _ in range(LOOKS)]
        for before, after in pairwise(states):
            require(
                after.step >= before.step and after.stamp >= before.stamp,
                f"step {before.step} at {before.stamp} s is followed by step {after.step} at {after.stamp} s",
            )
        return ""

    def stops(self) -> str:
        """Check that a standing robot accepts a stop and can be closed."""
        self.robot.stop()
        getattr(self.robot, "close", self.robot.stop)()
        return ""


@dataclass(frozen=True, slots=True)
class PluginRow:
    """One plug-in of the list, and whether it can be used."""

    group: str
    name: str
    package: str
    version: str
    works: bool
    """Whether it can be loaded and has the right type; `ltvn plugins test NAME` checks more."""
    why: str
    """The problem; empty if it works."""

    def __str__(self) -> str:
        mark = "works" if self.works else f"cannot be used: {self.why}"
        return f"{self.group:<16} {self.name:<14} {self.package} {self.version}  {mark}"


def installed_plugins() -> list[Plugin]:
    """Return all plug-ins, group by group."""
    return [plugin for group in GROUPS for plugin in find_plugins(group, first=_FIRST.get(group, ())).values()]


def plugin_row(plugin: Plugin) -> PluginRow:
    """Load a plug-in without creating an object with it."""
    try:
        _load(plugin)
        why = ""
    except LtvnError as error:
        why = str(error)
    return PluginRow(plugin.group.name, plugin.name, plugin.package, plugin.version, works=not why, why=why)


def contract_checks(plugin: Plugin, weights: Path | None = None) -> Iterator[ContractCheck]:
    """Yield the results of all checks of a plug-in's contract; only a predictor takes weights."""
    if plugin.group == PREDICTORS:
        return predictor_checks(plugin, weights)
    checks = _CONTRACTS.get(plugin.group, _loads)
    return checks(plugin)


def _loads(plugin: Plugin) -> Iterator[ContractCheck]:
    """Check only that a verb or a question can be loaded."""

    def load() -> str:
        _load(plugin)
        return plugin.place

    return run_checks(("can be loaded", load), ())


def _scene_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    from ltvn_core.verbs.contracts.plugin_contracts import scene_checks  # Needs the simulator's libraries.

    return scene_checks(plugin)


def _load(plugin: Plugin) -> None:
    """Load a plug-in. Raises PluginError if it cannot be called, or is not a navigation system where one is
    expected."""
    if plugin.group == SYSTEMS:
        load_system(plugin)
    elif not callable(plugin.load()):
        raise plugin.refusal("cannot be called")


_CONTRACTS: Mapping[PluginGroup, Callable[[Plugin], Iterator[ContractCheck]]] = {
    SYSTEMS: system_checks,
    ROBOTS: robot_checks,
    READERS: reader_checks,
    SCENES: _scene_checks,
}
