"""`ltvn measure`: the constants of Eq. 3 and Eq. 4, and the errors behind them, from simulated drives."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NoReturn

from ltvn_core.errors import OptionError, WeightsError
from ltvn_core.training.held_out_scenes import TEST_SCENES
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.part_summary import PartSummary
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from tqdm import tqdm

    from ltvn_core.evaluation.scene_figures import SceneFigures
    from ltvn_core.network.driving_calibration import DrivingMeasurements

IMAGES_PER_SCENE = 150
"""Images of the drive through each scene: more than a hundred thousand ordered pairs in six."""
_FEWEST_IMAGES = 10


@dataclass(frozen=True)
class MeasureSummary:
    """What simulated driving showed; `driving` holds all of it."""

    card: Path | None
    """The card that was written, if it was asked for."""
    refused: str | None
    """Why these figures cannot be the method's constants and were not written; None if they can."""
    p_success_if_reachable: float
    """p(s given r), Laplace's estimate."""
    p_success_if_not: float
    """p(s given not r), Laplace's estimate; the method's general one where no false edge looked like an edge."""
    sigma: float
    """Of d."""
    driving: "DrivingMeasurements"


@dataclass(frozen=True, kw_only=True)
class MeasureVerb(Verb):
    """Drive edges in simulation and measure the constants of Eq. 3 and Eq. 4; takes a few minutes."""

    predictor: PredictorName = "network"
    """What to measure: the trained network, or another predictor by name."""
    weights: Path | None = None
    """Weights to measure instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method that drives and judges."""
    attempts: int = 200
    """Edges to drive in all: half of them exist, half do not, or fewer where the network is hard to mislead."""
    images: int = IMAGES_PER_SCENE
    """Images of the drive through each scene."""
    seed: int = 0
    """Draws drives, edges, starts and odometry noise."""
    scenes: tuple[str, ...] = TEST_SCENES
    """Scenes to drive in; the default ones no weights have learned from or were chosen by."""
    body: BodyOption = "auto"
    folder: Path | None = None
    """Keep what each scene showed here, so that a stopped measurement goes on, and parts come together."""
    part: str = ""
    """Only a share of the scenes, as 3/16 is the third of sixteen; for arrays of jobs. The last one sums up."""
    write: bool = False
    """Write the result into the weights' card, or beside the geometric predictor, from where the method takes its
    constants."""

    def run(self) -> Summary:
        """Drive and measure; raises OptionError, SceneError and, for weights that cannot be read, WeightsError."""
        from ltvn_core.network.driving_calibration import likelihoods

        self._check()
        measured = self._measure()
        if isinstance(measured, PartSummary):
            return measured
        refused, constants = None, None
        try:
            constants = likelihoods(measured)
        except WeightsError as error:
            refused = str(error)
        return MeasureSummary(
            self._write(measured) if self.write and refused is None else None,
            refused,
            measured.success_if_reachable.shrunk,
            measured.success_if_not.shrunk if constants is None else constants.p_success_if_not,
            measured.distance_sigma,
            measured,
        )

    def _check(self) -> None:
        if not self.scenes:
            raise OptionError("--scenes needs at least one scene by name.")
        if self.write and self.predictor not in (AUTO, "network", "geometric"):
            raise OptionError(f"--write is for network and geometric; {self.predictor} says itself what was measured.")
        if self.attempts < 2 * len(self.scenes):
            raise OptionError(f"--attempts must be two or more per scene, so {2 * len(self.scenes)} or more.")
        if self.images < _FEWEST_IMAGES:
            raise OptionError(
                f"--images must be {_FEWEST_IMAGES} or more, got {self.images}; fewer have hardly an edge."
            )

    def _measure(self) -> "DrivingMeasurements | PartSummary":
        """Measure the scenes of this part, and sum up if none is missing any more."""
        from tqdm import tqdm

        from ltvn_core.evaluation.likelihood_measurement import summarise_measurements
        from ltvn_core.evaluation.parts import Part

        started, part = time.monotonic(), Part.parse(self.part)
        if self.folder is None and part.count > 1:
            raise OptionError("--part needs a --folder, where all parts lay what they measure.")
        mine = part.of(self._attempts_in_scenes())
        with tqdm(total=sum(attempts for _, _, attempts in mine), desc="measure", unit="edge") as bar:
            here = {name: self._measured(number, name, attempts, bar) for number, name, attempts in mine}
        found = {name: here.get(name) or self._kept(name) for name in self.scenes}
        whole = [figures for figures in found.values() if figures is not None]
        if len(whole) < len(self.scenes):
            assert self.folder is not None
            wall_s = time.monotonic() - started
            return PartSummary(str(part), len(mine), len(self.scenes), len(whole), self.folder, wall_s)
        return summarise_measurements(whole, self._command())

    def _attempts_in_scenes(self) -> list[tuple[int, str, int]]:
        """Return number, name and attempts of each scene."""
        share, more = divmod(self.attempts, len(self.scenes))
        return [(number, name, share + (number < more)) for number, name in enumerate(self.scenes)]

    def _measured(self, number: int, name: str, attempts: int, bar: "tqdm[NoReturn]") -> "SceneFigures":
        """Return what is kept of a scene, or measure it and keep that."""
        if (kept := self._kept(name)) is not None:
            bar.update(attempts)
            return kept
        figures = self._measure_scene(number, name, attempts, bar)
        if self.folder is not None:
            figures.save(self._file(name))
        return figures

    def _kept(self, name: str) -> "SceneFigures | None":
        from ltvn_core.evaluation.scene_figures import SceneFigures
        from ltvn_core.evaluation.trial_plans import claim_settings
        from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
        from ltvn_core.network.weights_file import weights_fingerprint
        from ltvn_core.simulation.body_selection import choose_body

        if self.folder is None:
            return None
        named = asdict(self) | {"weights": weights_fingerprint(self.weights or SHIPPED_WEIGHTS)}
        for option in ("json", "debug", "write", "folder", "part"):
            del named[option]
        named["body"] = choose_body(self.body)
        if named["body"] == "bullet":  # As when there was no other.
            del named["body"]
        claim_settings(self.folder / "measure.json", named)
        return SceneFigures.load(self._file(name)) if self._file(name).exists() else None

    def _file(self, name: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{Path(name).stem}.measured.npz"

    def _measure_scene(self, number: int, name: str, attempts: int, bar: "tqdm[NoReturn]") -> "SceneFigures":
        import numpy as np

        from ltvn_core.config import preset
        from ltvn_core.evaluation.likelihood_measurement import measure_scene
        from ltvn_core.predictors.choice import ImageSource
        from ltvn_core.predictors.opening import open_predictor, simulated_robot
        from ltvn_core.robots.robot_spec import LOCOBOT
        from ltvn_core.simulation.rendering.renderer_selection import open_renderer
        from ltvn_core.simulation.scene_registry import load_scene

        choice = ImageSource(camera=LOCOBOT.camera).choose(self.predictor)
        spec, scene = simulated_robot(choice.name), load_scene(name)
        return measure_scene(
            scene,
            open_renderer(scene, spec.camera),
            open_predictor(choice.name, name, self.weights, camera=spec.camera),
            preset(self.preset),
            attempts=attempts,
            images=self.images,
            rng=np.random.default_rng([self.seed, number]),
            progress=bar.update,
            spec=spec,
            body=self.body,
        )

    def _command(self) -> str:
        from ltvn_core.simulation.body_selection import choose_body

        named = "" if self.scenes == TEST_SCENES else f" --scenes {' '.join(self.scenes)}"
        of = "" if self.predictor in (AUTO, "network") else f" --predictor {self.predictor}"
        images = "" if self.images == IMAGES_PER_SCENE else f" --images {self.images}"
        body = " --body planar" if choose_body(self.body) == "planar" else ""
        counts = f"--attempts {self.attempts}{images} --seed {self.seed}"
        return f"ltvn measure{of} {counts} --preset {self.preset}{body}{named}"

    def _write(self, measured: "DrivingMeasurements") -> Path:
        if self.predictor == "geometric":
            from ltvn_core.predictors.geometric import write_driving

            return write_driving(measured)
        from ltvn_core.network.driving_calibration import DRIVING_SECTION
        from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
        from ltvn_core.network.weights_file import add_to_card

        return add_to_card(self.weights or SHIPPED_WEIGHTS, DRIVING_SECTION, asdict(measured))
