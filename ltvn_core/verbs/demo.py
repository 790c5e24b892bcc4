"""The complete workflow without a browser: collect, build, navigate with maintenance, record. Part of `ltvn demo`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class HeadlessDemoVerb(Verb):
    """Collect, build, navigate and record, without a browser."""

    job = "ltvn_core.verbs.jobs.demo:run_demo"

    queries: int = 20
    """Number of random goals to drive to."""
    seed: int = 0
    """Seed of tour, noise, map and goals."""
    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    loops: int = 2
    """Number of rounds of the mapping drive."""
    predictor: PredictorName = AUTO
    """Predictor that compares images: the trained network, which auto uses, or another by name."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    body: BodyOption = "auto"
    recording: NewRecording | None = None
    """The recording to write; by default runs/demo-SCENE-SEED-TIME.rrd."""
    map: NewRecording | None = None
    """Also save the final map here."""
    stream: int | None = None
    """Port on 127.0.0.1 for a Rerun viewer to watch the recording while it is written; open it with `ltvn view` and the
    printed address."""

    story: bool = False
    """Instead of driving to random goals, close a door on the planned path and show what the map learns. It plays in
    the shipped map of the demo apartment."""
