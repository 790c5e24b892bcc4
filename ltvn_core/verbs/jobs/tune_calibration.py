"""`ltvn finetune --predictor geometric`: fits a calibration to a drive. Needs no network, and therefore no torch.

Owns the checks of all options of `ltvn finetune`, and the command line in the cards.
"""

from typing import cast

from tqdm import tqdm

from ltvn_core.data.recording.drive_part import parse_part
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.training.calibration_tuning import tune_calibration
from ltvn_core.verbs.finetune import FinetuneVerb
from ltvn_core.verbs.verb import Summary


def finetune_calibration(options: FinetuneVerb) -> Summary:
    """Fit, evaluate and save; raises OptionError and RecordingError."""
    check_options(options)
    part = parse_part(options.part)
    recording = Recording.open(options.recording)
    predictor = open_predictor(options.predictor, weights=options.weights, camera=recording.meta.camera)
    with _StepBar() as bar:
        return tune_calibration(
            recording,
            cast(GeometricPredictor, predictor),
            options.output,
            command=tuning_command(options),
            part=part,
            seed=options.seed,
            on_progress=bar,
        )


def check_options(options: FinetuneVerb) -> None:
    """Raise OptionError for invalid options, for either predictor."""
    if options.horizon < 2:
        raise OptionError(f"--horizon must be 2 or more images, got {options.horizon}; 15 is a good start.")
    if not options.minutes > 0:
        raise OptionError(f"--minutes must be above 0, got {options.minutes:g}; 3 is a good start.")
    suffix = ".safetensors" if options.predictor == "network" else ".json"
    if options.output.suffix != suffix:
        raise OptionError(f"--output must end in {suffix}, got {options.output.name}.")


def tuning_command(options: FinetuneVerb) -> str:
    """Return the command line for a card."""
    words = [f"--output {options.output.name}"]
    if options.predictor == "network":
        words += [f"--horizon {options.horizon}", f"--minutes {options.minutes:g}"]
    else:
        words.append(f"--predictor {options.predictor}")
    words += ["--literal"] * options.literal
    words += [f"--part {options.part}"] * (options.part != "1/1")
    words += [f"--{name} {path.name}" for name in ("weights", "data") if (path := getattr(options, name)) is not None]
    return " ".join([f"ltvn finetune {options.recording.name}", *words, f"--seed {options.seed}"])


class _StepBar:
    """A progress bar for consecutive steps."""

    def __init__(self) -> None:
        self._bar = tqdm(desc="read")

    def __enter__(self) -> "_StepBar":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def __call__(self, step: str, done: int, total: int) -> None:
        if done == 1:
            self._bar.reset(total)
            self._bar.set_description(step)
        self._bar.update(1)
