"""`ltvn measure`: measures the constants of Eq. 3 and Eq. 4, and the errors behind them, in simulated drives."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from tqdm import tqdm

from ltvn_core.atomic_files import require_writable
from ltvn_core.config import preset
from ltvn_core.errors import OptionError, WeightsError
from ltvn_core.evaluation.likelihood_measurement import SceneFigures, measure_scene, summarise_measurements
from ltvn_core.evaluation.trial_plans import claim_settings
from ltvn_core.evaluation.workers import Part
from ltvn_core.network.driving_calibration import DRIVING_SECTION, DrivingMeasurements, likelihoods
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.weights_file import add_to_card, card_path, weights_fingerprint
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.predictors.geometric import DRIVING_FILE, write_driving
from ltvn_core.predictors.opening import open_predictor, simulated_robot
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.training.held_out_scenes import TEST_SCENES
from ltvn_core.verbs.jobs.evaluation_progress import PartSummary
from ltvn_core.verbs.measure import IMAGES_PER_SCENE, MeasureVerb
from ltvn_core.verbs.option_types import AUTO
from ltvn_core.verbs.verb import Summary

_FEWEST_IMAGES = 10


@dataclass(frozen=True)
class MeasureSummary:
    """Measurements from simulated driving; `driving` contains all of them."""

    card: Path | None
    """The card that was written; None if none was."""
    refused: str | None
    """Reason why these figures cannot be the method's constants and were not written; None if they can."""
    p_success_if_reachable: float
    """p(s given r), estimated with Laplace's rule."""
    p_success_if_not: float
    """p(s given not r), estimated with Laplace's rule; if no false edge looked like an edge, the method's general
    value."""
    sigma: float
    """Standard deviation of d."""
    driving: DrivingMeasurements


def measure_driving(options: MeasureVerb) -> Summary:
    """Drive and measure; raises OptionError, SceneError and, for weights that cannot be read, WeightsError."""
    _check(options)
    measured = _measure(options)
    if isinstance(measured, PartSummary):
        return measured
    refused = None
    constants = None
    try:
        constants = likelihoods(measured)
    except WeightsError as error:
        refused = str(error)
    return MeasureSummary(
        _write(options, measured) if options.write and refused is None else None,
        refused,
        measured.success_if_reachable.shrunk,
        measured.success_if_not.shrunk if constants is None else constants.p_success_if_not,
        measured.distance_sigma,
        measured,
    )


def _check(options: MeasureVerb) -> None:
    if not options.scenes:
        raise OptionError("--scenes needs at least one scene by name.")
    if options.write and options.predictor not in (AUTO, "network", "geometric"):
        raise OptionError(
            f"--write works only with network and geometric; {options.predictor} has its measurements in its own card."
        )
    if options.write:
        is_geometric = options.predictor == "geometric"
        require_writable(DRIVING_FILE if is_geometric else card_path(options.weights or SHIPPED_WEIGHTS))
    if options.attempts < 2 * len(options.scenes):
        raise OptionError(f"--attempts must be two or more per scene, so {2 * len(options.scenes)} or more.")
    if options.images < _FEWEST_IMAGES:
        raise OptionError(
            f"--images must be {_FEWEST_IMAGES} or more, got {options.images}; with fewer there is hardly an edge."
        )


def _measure(options: MeasureVerb) -> DrivingMeasurements | PartSummary:
    """Measure the scenes of this part, and sum up once all scenes are measured."""
    started = time.monotonic()
    part = Part.parse(options.part)
    if options.folder is None and part.count > 1:
        raise OptionError("--part needs a --folder, in which all parts store their measurements.")
    mine = part.of(_attempts_in_scenes(options))
    with tqdm(total=sum(attempts for _, _, attempts in mine), desc="measure", unit="edge") as bar:
        here = {name: _measured(options, number, name, attempts, bar) for number, name, attempts in mine}
    found = {name: here.get(name) or _kept(options, name) for name in options.scenes}
    whole = [figures for figures in found.values() if figures is not None]
    if len(whole) < len(options.scenes):
        assert options.folder is not None
        wall_s = time.monotonic() - started
        return PartSummary(str(part), len(mine), len(options.scenes), len(whole), options.folder, wall_s)
    return summarise_measurements(whole, _command(options))


def _attempts_in_scenes(options: MeasureVerb) -> list[tuple[int, str, int]]:
    """Return number, name and attempts for each scene."""
    share, more = divmod(options.attempts, len(options.scenes))
    return [(number, name, share + (number < more)) for number, name in enumerate(options.scenes)]


def _measured(options: MeasureVerb, number: int, name: str, attempts: int, bar: "tqdm[NoReturn]") -> SceneFigures:
    """Return the stored figures of a scene, or measure the scene and store them."""
    if (kept := _kept(options, name)) is not None:
        bar.update(attempts)
        return kept
    figures = _measure_scene(options, number, name, attempts, bar)
    if options.folder is not None:
        figures.save(_file(options, name))
    return figures


def _kept(options: MeasureVerb, name: str) -> SceneFigures | None:
    if options.folder is None:
        return None
    named = asdict(options) | {"weights": weights_fingerprint(options.weights or SHIPPED_WEIGHTS)}
    for option in ("json", "debug", "write", "folder", "part"):
        del named[option]
    named["body"] = choose_body(options.body)
    if named["body"] == "bullet":  # Left out, so that files from before there was another body stay valid.
        del named["body"]
    claim_settings(options.folder / "measure.json", named)
    return SceneFigures.load(_file(options, name)) if _file(options, name).exists() else None


def _file(options: MeasureVerb, name: str) -> Path:
    assert options.folder is not None
    return options.folder / f"{Path(name).stem}.measured.npz"


def _measure_scene(options: MeasureVerb, number: int, name: str, attempts: int, bar: "tqdm[NoReturn]") -> SceneFigures:
    choice = ImageSource(camera=LOCOBOT.camera).choose(options.predictor)
    spec = simulated_robot(choice.name)
    scene = load_scene(name)
    return measure_scene(
        scene,
        open_renderer(scene, spec.camera),
        open_predictor(choice.name, name, options.weights, camera=spec.camera),
        preset(options.preset),
        attempts=attempts,
        images=options.images,
        rng=np.random.default_rng([options.seed, number]),
        progress=bar.update,
        spec=spec,
        body=options.body,
    )


def _command(options: MeasureVerb) -> str:
    named = "" if options.scenes == TEST_SCENES else f" --scenes {' '.join(options.scenes)}"
    of = "" if options.predictor in (AUTO, "network") else f" --predictor {options.predictor}"
    images = "" if options.images == IMAGES_PER_SCENE else f" --images {options.images}"
    body = " --body planar" if choose_body(options.body) == "planar" else ""
    counts = f"--attempts {options.attempts}{images} --seed {options.seed}"
    return f"ltvn measure{of} {counts} --preset {options.preset}{body}{named}"


def _write(options: MeasureVerb, measured: DrivingMeasurements) -> Path:
    if options.predictor == "geometric":
        return write_driving(measured)
    return add_to_card(options.weights or SHIPPED_WEIGHTS, DRIVING_SECTION, asdict(measured))
