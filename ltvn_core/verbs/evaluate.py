"""`ltvn evaluate`: the paper's protocol, for LTVN and its rivals."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ltvn_core.evaluation.condition_names import ConditionName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName, SystemName
from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions(Verb):
    """Options shared by the verbs that test a method by the paper's protocol."""

    scene: tuple[str, ...] = ("demo",)
    """Scenes by name (a wrong one lists the right ones), or paths of meshes or of Gibson folders."""
    seed: tuple[int, ...] = (0,)
    """Seeds of drive, noise, map, goals and episodes; several seeds are run one after the other."""
    preset: Literal["robust", "paper"] = "robust"
    """The navigator's settings: robust is ours, paper is the literal method."""
    without: tuple[str, ...] = ()
    """Parts of the method to switch off. One of the paper's parts: merging, pruning, expansion, fine-tuning. Or all our
    changes to one step of the paper's method: our-matching, our-building, our-localising, our-planning, our-driving,
    our-judging, our-believing, our-expanding, our-recovering. Or one of our changes by its name in config.py, for
    instance driving.swerve."""
    predictor: PredictorName = AUTO
    """Predictor that compares images: the trained network, which auto uses, or another by name."""
    weights: Path | None = None
    """Weights to start from instead of the shipped ones."""
    finetune_steps: int = 40
    """Number of steps of fine-tuning on the mapping drive."""
    loops: int = 3
    """Number of rounds of the mapping drive."""
    goals: int = 10
    """Number of goal images."""
    step_limit: int | None = None
    """Number of control steps after which an episode has failed; by default as in the paper, 1,000 in scenes below 100
    m2 and 2,000 above."""
    conditions: tuple[ConditionName, ...] = ()
    """Harder conditions, the same for all systems. slip: the wheels slip, in the mapping drive and in the episodes.
    one-loop: the mapping drive is one round. half-light: the map is made in full light, and the episodes have half of
    it."""
    body: BodyOption = "auto"
    folder: FilledFolder = Path("runs/evaluation")
    """Folder of drives, weights, maps and results; the next call continues from them."""
    processes: int | None = None
    """Number of processes; by default one per core."""
    cluster: str | None = None
    """Run on a Dask cluster instead: tcp://HOST:PORT of a running one, or local:N, which starts N workers on this
    machine. All machines must have access to the folder."""
    part: str = ""
    """Only a share of the work, for arrays of independent jobs; 3/16 is the third of sixteen. When all parts have run,
    in one folder or copied into one, run the command without this option to sum up."""


@dataclass(frozen=True, kw_only=True)
class EvaluateVerb(ProtocolOptions):
    """Test a method as the paper does: map a scene, fine-tune, build, and drive random episodes without maintenance."""

    job = "ltvn_core.verbs.jobs.evaluate:evaluate"

    system: SystemName = DEFAULT_SYSTEM
    """The navigation system: ltvn is the paper's, the others are rivals in the same harness."""
    episodes: int = 500
    """Random episodes for each scene and seed."""
    perturb: tuple[str, ...] = ()
    """Faults of the robot's camera in the episodes, all at the same time: one or several of blur, exposure, flare,
    depth-holes, lens, noise, white-balance, jpeg, dropped-frames, or all. The map is built with a good camera."""
    record_failures: int = 0
    """Number of failed episodes per scene and seed that are run again and recorded, for `ltvn replay`."""
