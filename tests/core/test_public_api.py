"""What `import ltvn_core as ltvn` promises: its names, that they are explained, and that it costs nothing."""

import inspect
import subprocess
import sys

import pytest

import ltvn_core as ltvn

PUBLIC = {
    "Belief",
    "CameraModel",
    "DriveLease",
    "LOCOBOT",
    "LtvnError",
    "Method",
    "NavigationSystem",
    "Navigator",
    "Observation",
    "PAPER",
    "Prediction",
    "Predictor",
    "PredictorRequest",
    "QueryEnded",
    "ROBUST",
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
}


def test_the_public_names_are_these() -> None:
    assert set(ltvn.__all__) == PUBLIC
    assert set(dir(ltvn)) == PUBLIC


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_each_public_name_can_be_used(name: str) -> None:
    assert getattr(ltvn, name) is not None


@pytest.mark.parametrize("name", sorted(PUBLIC - {"__version__", "LOCOBOT", "PAPER", "ROBUST"}))
def test_each_public_name_says_what_it_is(name: str) -> None:
    assert inspect.getdoc(getattr(ltvn, name))


@pytest.mark.parametrize("name", sorted(name for name in PUBLIC if inspect.isfunction(getattr(ltvn, name))))
def test_each_public_function_explains_its_arguments_and_errors(name: str) -> None:
    function = getattr(ltvn, name)
    text = inspect.getdoc(function) or ""
    assert "Raises:" in text, name
    for parameter in inspect.signature(function).parameters:
        assert f"{parameter}:" in text, (name, parameter)


def test_an_unknown_name_is_said_to_be_unknown() -> None:
    with pytest.raises(AttributeError, match=r"build_mapp.*__all__"):
        ltvn.build_mapp  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize(
    ("module", "unneeded"),
    [
        ("ltvn_core", {"torch", "rerun", "pybullet", "viser", "cv2", "scipy", "matplotlib", "ltvn_viz"}),
        ("ltvn_core.verbs.recording_files", {"torch", "pybullet", "viser", "scipy", "matplotlib", "trimesh"}),
        ("ltvn_viz.debugger.file_questions", {"torch", "pybullet", "viser", "matplotlib", "trimesh"}),
    ],
)
def test_nothing_heavy_is_loaded_that_is_not_needed(module: str, unneeded: set[str]) -> None:
    program = f"import sys, {module}; print(sorted({unneeded} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
