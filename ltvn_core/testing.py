"""What each kind of plug-in must do, as functions of asserts: for the tests of its author, and `ltvn plugins test`.

Each function takes what the entry point names, and raises AssertionError, or whatever the plug-in raises. Nothing is
driven. The images, where some are needed, are those of the demo map.
"""

import math
import pickle
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.data.importing.frame_preparation import FramePreparation
from ltvn_core.data.importing.raw_frame import DriveFacts, RawFrame, ReadOptions
from ltvn_core.data.recording.demo_files import DEMO_MAP, demo_file
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import ImageError, RecordingError
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.request import PredictorRequest, predictor_card
from ltvn_core.preprocessing import admit_observation, recorded_observation
from ltvn_core.robots.robot_plugins import check_robot as require_robot
from ltvn_core.types import Features, Observation, Prediction, Predictor

_IMAGES = 8
_FRAMES = 50
_ROUNDS = 10
_STEP_S = 0.1
_TOLERANCE = 0.01
"""Of equal results: batches of another size may add numbers in another order, and features may be half floats."""
_SAME_PLACE_R = 0.5
_SAME_PLACE_M = 0.25
_WALL_M = 1.0


def check_predictor(make: Callable[[PredictorRequest], Predictor], weights: Path | None = None) -> None:
    """Check a predictor with eight images: shapes, numbers, and equal answers to equal questions."""
    seen, meta = _demo_images(_IMAGES)
    request = PredictorRequest(meta.scene, weights, meta.camera)
    predictor = make(request)
    card = predictor_card(predictor)
    assert card.fingerprint == predictor_card(make(request)).fingerprint, "its fingerprint changes when opened again"
    known = card.likelihoods
    if known is not None:
        assert 0 < known.p_success_if_not < known.p_success_if_reachable < 1, f"p(s | r) of its likelihoods: {known}"
        assert known.sigma2 > 0, f"sigma2 of its likelihoods: {known}"
    images = [recorded_observation(each, meta.camera, predictor.camera) for each in seen]

    rows = predictor.encode(images)
    assert isinstance(rows, np.ndarray), f"encode must return a numpy array, got {type(rows).__name__}"
    assert (rows.ndim, len(rows)) == (2, _IMAGES), f"encode must return (N, F), got {rows.shape} for {_IMAGES} images"

    first, second = _compared(predictor, rows), _compared(predictor, rows)
    assert np.array_equal(first.reachability, second.reachability), "the second answer differs from the first"
    assert np.array_equal(first.waypoints, second.waypoints), "the second answer differs from the first"

    _assert_equal(_compared(predictor, predictor.encode(images[::-1])[::-1]), _compared(predictor, rows), "reversed")
    alone = np.concatenate([predictor.encode([image]) for image in images])
    _assert_equal(_compared(predictor, alone), _compared(predictor, rows), "encoded one by one")

    single = [predictor.predict(rows[:1], rows[k : k + 1]) for k in range(_IMAGES)]
    joined = Prediction(
        np.concatenate([each.reachability for each in single]), np.concatenate([each.waypoints for each in single])
    )
    _assert_equal(_sound(predictor.predict(rows[:1], rows), _IMAGES), joined, "for many at once")
    assert len(predictor.encode([])) == 0, "encode must return zero rows for zero images"
    _sound(predictor.predict(rows[:1], rows[:0]), 0)

    same = predictor.predict(rows, rows)
    least, farthest = same.reachability.min(), np.hypot(*same.waypoints[:, :2].T).max()
    assert least >= _SAME_PLACE_R, f"an image and itself must have r of at least {_SAME_PLACE_R}, got {least:.2f}"
    assert farthest <= _SAME_PLACE_M, f"an image and itself must lie within {_SAME_PLACE_M} m, got {farthest:.2f} m"

    wall = np.full(images[0].rgb.shape[:2], _WALL_M, np.float32)
    _accepts(predictor, replace(images[0], rgb=np.zeros_like(images[0].rgb), depth=wall), rows)
    if not card.needs_depth:
        _accepts(predictor, replace(images[0], depth=np.zeros_like(wall)), rows)
        _accepts(predictor, replace(images[0], depth=None), rows)

    assert pickle.loads(pickle.dumps(make)) is make, "its factory must be a function or class of a module"


def check_system(make: Any) -> None:
    """Let a system, or the SystemEntry of one, build a small map twice."""
    system = getattr(make, "factory", make)(ROBUST)
    assert isinstance(system, NavigationSystem), f"it must make a NavigationSystem, got {type(system).__name__}"
    parts = ("build", "edge_weight", "localise", "subgoal")
    missing = [part for part in parts if not callable(getattr(system, part))]
    assert not missing, f"these parts cannot be called: {', '.join(missing)}"
    seen, meta = _demo_images(12)

    def built() -> tuple[Any, ...]:
        predictor = GeometricPredictor(meta.camera)
        return tuple(system.build(seen, KeyframeStore(predictor), predictor, rng=np.random.default_rng(0)))

    deltas = built()
    graph = TopologicalGraph(deltas)
    assert graph.nodes, "its map has no node"
    assert {*graph.nodes, *graph.reserve} <= {each.step for each in seen}, (
        "it has nodes that are no images of the drive"
    )
    assert built() == deltas, "the second map differs; draw random numbers only from `rng`"
    costs = [system.edge_weight(edge.belief) for edge in graph.edges.values()]
    assert all(math.isfinite(cost) and cost >= 0 for cost in costs), f"got {costs[:3]}"


def check_reader(reader: Any, path: Path | None = None) -> None:
    """Let a reader recognise and read a drive; without one (None), only let it look at what is no drive."""
    with tempfile.TemporaryDirectory(prefix="ltvn-") as name:
        noise = Path(name) / "noise.bin"
        noise.write_bytes(bytes(range(256)) * 16)
        (Path(name) / "empty").mkdir()
        for place in (noise, noise.with_name("empty"), noise.with_name("not-there")):
            assert not reader.recognises(place), f"it claims to recognise {place.name}"
    if path is None:
        assert callable(reader.open), "it has no class method open"
        return
    assert reader.recognises(path), f"it does not recognise {path}"
    drive = reader.open(path, ReadOptions())
    assert isinstance(drive.facts, DriveFacts), f"`facts` must be a DriveFacts, got {type(drive.facts).__name__}"
    frames = list(islice(drive.frames(), _FRAMES))
    assert frames, "it yields no frame"
    for frame in frames:
        assert isinstance(frame, RawFrame), f"it must yield RawFrame, got {type(frame).__name__}"
    unordered = [(a.stamp, b.stamp) for a, b in pairwise(frames) if not a.stamp < b.stamp]
    assert not unordered, f"{unordered[0][0]} s is followed by {unordered[0][1]} s"
    preparation = FramePreparation(frames[0])
    for k, frame in enumerate(frames):
        preparation.observation(frame, step=k, odometry=np.zeros(3) if frame.odometry is None else frame.odometry)
    for role, part in (("odometry", "odometry"), ("truth", "truth"), ("depth", "depth_m")):
        named = any(stream.role == role and stream.count != 0 for stream in drive.facts.streams)
        assert not named or any(getattr(frame, part) is not None for frame in frames), f"no frame has {role}"
    assert all(isinstance(count, int) for count in dict(drive.dropped).values()), "`dropped` must count"
    assert all(isinstance(doubt, str) for doubt in drive.doubts), "`doubts` must be sentences"


def check_robot(make: Callable[[], Any]) -> None:
    """Look at a robot that stands still for a second; it is not driven."""
    robot = make()
    require_robot(robot, getattr(make, "__name__", "robot"))
    camera = robot.spec.camera
    try:
        seen: list[Observation] = []
        states: list[Any] = []
        for _ in range(_ROUNDS):
            try:
                seen.append(admit_observation(robot.observe(), camera, camera, source=robot.spec.name))
            except ImageError as error:
                raise AssertionError(str(error)) from error
            states.append(robot.state())
            robot.clock.advance(_STEP_S)
        for name, listed in (("observe()", seen), ("state()", states)):
            for each in ("step", "stamp"):
                values = [getattr(one, each) for one in listed]
                assert values == sorted(values), f"the {each} of {name} decreases: {values}"
                assert values[-1] > values[0], f"the {each} of {name} is always {values[0]}, for a second of its clock"
        robot.stop()
    finally:
        getattr(robot, "close", robot.stop)()


def check_scene(make: Callable[[], Any]) -> None:
    """Open a scene, or the mesh whose path is returned, and find a free place."""
    from ltvn_core.simulation.meshes.mesh_scene import load_mesh_scene  # The simulator may not be installed.
    from ltvn_core.simulation.scene import Scene

    made = make()
    scene = load_mesh_scene(Path(made)) if isinstance(made, str | Path) else made
    assert isinstance(scene, Scene), f"it must return a Scene or the path of a mesh, got {type(made).__name__}"
    poses = scene.clearance.sample_poses(np.random.default_rng(0), 10)
    assert np.all(scene.clearance.at(poses[:, :2]) > 0), "free places lie within obstacles"
    surfaces = scene.surfaces
    assert len(surfaces.faces) > 0, "it has no triangles"
    assert surfaces.faces.max() < len(surfaces.vertices), "faces refer to missing vertices"
    assert surfaces.face_texture.max() < len(surfaces.textures), "faces refer to missing textures"


def _demo_images(count: int) -> tuple[Sequence[Observation], RecordingMetadata]:
    path = demo_file(DEMO_MAP)
    if path is None:
        raise RecordingError(f"{DEMO_MAP} is missing; reinstall the toolkit: pip install ltvn (or -e .)")
    recording = Recording.open(path)
    return tuple(recording.observation(frame) for frame in recording.frames[:count]), recording.meta


def _compared(predictor: Predictor, rows: Features) -> Prediction:
    """Compare all images with all images."""
    count = len(rows)
    all_pairs = np.repeat(np.arange(count), count), np.tile(np.arange(count), count)
    return _sound(predictor.predict(rows[all_pairs[0]], rows[all_pairs[1]]), count * count)


def _accepts(predictor: Predictor, seen: Observation, others: Features) -> None:
    row = predictor.encode([seen])
    _sound(predictor.predict(row, others), len(others))
    _sound(predictor.predict(row, row), 1)


def _sound(found: Prediction, count: int) -> Prediction:
    r, waypoints = np.asarray(found.reachability), np.asarray(found.waypoints)
    shapes = f"predict must return r ({count},) and waypoints ({count}, 3), got {r.shape} and {waypoints.shape}"
    assert (r.shape, waypoints.shape) == ((count,), (count, 3)), shapes
    assert np.isfinite([*r, *waypoints.ravel()]).all(), "r and waypoints must be finite"
    assert np.all((r >= 0) & (r <= 1)), f"r must lie in [0, 1], got {r.min():.3g} to {r.max():.3g}"
    return found


def _assert_equal(found: Prediction, expected: Prediction, how: str) -> None:
    gaps = np.abs(found.reachability - expected.reachability), np.abs(found.waypoints - expected.waypoints)
    apart = max(float(gap.max(initial=0)) for gap in gaps)
    assert apart <= _TOLERANCE, f"the answers {how} differ by {apart:.3g}"
