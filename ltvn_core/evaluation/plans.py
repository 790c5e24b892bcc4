"""Plans of evaluations, and the paths of their files.

A plan is one method in one scene with one map seed and one schedule: static episodes alone, queries with maintenance
and episodes in between, or queries in a changing world. Guarantees that results of different plans are never mixed.
Runs nothing.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

from ltvn_core.atomic_files import write_text_atomically
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.method_parts import FINE_TUNING, method_parts, without_parts
from ltvn_core.evaluation.protocol import (
    EvaluationProtocol,
    drive_conditions,
    episode_conditions,
    told_conditions,
)
from ltvn_core.evaluation.results import OWN_MAINTENANCE, ROWS, RunColumns, drawing_path, failure_path
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.predictors.opening import NETWORK, open_method
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world_script import DAY_S, MORNING_S, WorldScript
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.structured_text import parse_json
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.systems.registry import DEFAULT_SYSTEM, network_owner, system_entry
from ltvn_core.systems.registry import open_system as open_named_system
from ltvn_core.types import Predictor

_LONGEST_LABEL = 120
"""Maximum number of characters of a label; file systems allow 255 for a name including its endings."""


WEEK_DAYS = 7.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Order of the queries that may change a map, and of the static episodes before, between and after them.

    The default has no such queries: a static test of the map as it was built. In a changing world there are no
    episodes.
    """

    queries: int = 0
    """Number of queries with maintenance (paper: 700)."""
    every: int = 100
    """Number of queries between two static tests (paper)."""
    world: str | None = None
    """Name of the script of a changing world, or path of its file."""
    days: float = WEEK_DAYS
    """Number of simulated days over which the queries in a changing world are spread evenly."""

    def __post_init__(self) -> None:
        if self.queries < 0 or self.every < 1 or not 0 < self.days <= 365 or (self.world and not self.queries):
            raise OptionError(
                "A test with maintenance needs one query and one between two tests at least, and more than 0 and at "
                f"most 365 days, got {self.queries} queries, every {self.every}, {self.days:g} days."
            )

    @property
    def tests(self) -> tuple[int, ...]:
        """Numbers of queries after which the map is tested, from 0 to all; empty in a changing world."""
        return () if self.world else (*range(0, self.queries, self.every), self.queries)

    @property
    def stretches(self) -> tuple[tuple[int, int], ...]:
        """First query of each stretch without a test in between, and the query after its last."""
        return ((0, self.queries),) if self.world else tuple(pairwise(self.tests))

    @property
    def slot_s(self) -> float:
        """Mean time from one query in a changing world to the next, in seconds."""
        return self.days * DAY_S / self.queries

    @property
    def label(self) -> str:
        """Name of the schedule in file names; without a world, a longer schedule begins as a shorter one does."""
        return f"{Path(self.world).stem}-{self.queries}-in-{self.days:g}-days" if self.world else "lifelong"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPlan:
    """One method in one scene with one map seed, and its schedule."""

    scene: str
    """Name of the scene, or path of a mesh."""
    seed: int
    """Seed of the drive, the map, the goals and the episodes."""
    system: str = DEFAULT_SYSTEM
    preset: str = "robust"
    """Preset of the navigator, which is the same for all systems."""
    parts_off: tuple[str, ...] = ()
    """Parts of the method that are switched off, see `evaluation.method_parts`."""
    predictor: str = NETWORK
    """Name of the predictor."""
    device: str = "cpu"
    """Where a network computes: cpu, cuda or mps."""
    perturbations: tuple[str, ...] = ()
    """Perturbations of the robot's camera in the episodes, not in the mapping drive."""
    conditions: tuple[str, ...] = ()
    """Harder conditions than usual, see `evaluation.protocol`; the plan's protocol already includes them."""
    weights: Path | None = None
    """Weights to start from instead of the shipped ones of the system."""
    finetune_steps: int = 40
    """Number of steps of fine-tuning on the mapping drive."""
    maintenance: str | None = None
    """Name of the maintenance in queries that may change the map; None is that of the system."""
    schedule: Schedule = field(default_factory=Schedule)
    protocol: EvaluationProtocol = field(default_factory=EvaluationProtocol)

    def __post_init__(self) -> None:
        if unknown := set(self.parts_off) - set(method_parts()):
            raise OptionError(
                f"There is no part {sorted(unknown)} to leave out; choose from: {', '.join(method_parts())}."
            )
        if self.finetune_steps < 0 or self.seed < 0:
            raise OptionError(f"Seed and steps must be 0 or more, got {self.seed} and {self.finetune_steps}.")

    @property
    def finetuned(self) -> bool:
        """Whether the network is fine-tuned on the drive."""
        return bool(self.finetune_steps) and self.predictor == NETWORK and FINE_TUNING not in self.parts_off

    @property
    def start_weights(self) -> Path:
        """Weights that the system begins with."""
        return self.weights or system_entry(self.system).weights

    @property
    def static_label(self) -> str:
        """Name of the method in file names, without maintenance and schedule."""
        return self._named(maintenance=None)

    @property
    def label(self) -> str:
        """Name of the run in file names; a name that is too long is shortened and ends in a hash."""
        label = self._named(maintenance=self.maintenance)
        return f"{label}-{self.schedule.label}" if self.schedule.queries else label

    @property
    def columns(self) -> RunColumns:
        """Columns of all lines of the results."""
        schedule = self.schedule
        return RunColumns(
            scene=load_scene(self.scene).name,
            seed=self.seed,
            method=self.system,
            preset=self.preset,
            without=self.parts_off,
            finetuned=self.finetuned,
            predictor=self.predictor,
            perturbations=self.perturbations,
            conditions=told_conditions(self.protocol, self.conditions),
            maintenance=(self.maintenance or OWN_MAINTENANCE) if schedule.queries else None,
            world=schedule.world,
            days=schedule.days if schedule.world else None,
        )

    def script(self, scene: Scene) -> WorldScript:
        """Return the script of the changing world. Raises WorldError."""
        assert self.schedule.world is not None
        until_s = MORNING_S + self.schedule.days * DAY_S
        return make_script(self.schedule.world, scene, seed=self.seed, duration_s=until_s)

    def _named(self, maintenance: str | None) -> str:
        words = [self.system]
        words += [] if self.preset == "robust" else [self.preset]
        words += [] if self.predictor == NETWORK else [self.predictor]
        words += [maintenance] if maintenance else []
        words += [f"no-{part}" for part in self.parts_off]
        words += [f"with-{name}" for name in (*self.perturbations, *episode_conditions(self.conditions))]
        name = "-".join(words)
        if len(name) <= _LONGEST_LABEL:
            return name
        return f"{name[:_LONGEST_LABEL]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def open_planned_system(plan: RunPlan, predictor: Predictor, scene: Scene, *, maintain: bool) -> NavigationSystem:
    """Return the system of a plan with the constants of its predictor. Raises OptionError and WeightsError."""
    method = open_method(plan.preset, predictor)
    limits = {"step_limit": plan.protocol.steps_in(scene), "collision_limit": plan.protocol.collision_limit}
    method = replace(method, maintain=maintain, recovering=replace(method.recovering, **limits))
    system = open_named_system(plan.system, without_parts(method, set(plan.parts_off) - {FINE_TUNING}))
    return with_maintenance(system, plan.maintenance) if maintain and plan.maintenance else system


@dataclass(frozen=True, slots=True)
class RunFiles:
    """A plan, and the paths of its files. All methods share the drive; methods with the same training the weights."""

    plan: RunPlan
    folder: Path
    """Folder of the scene, the conditions of the mapping drive, and the seed."""
    run: Path
    """Folder of the plan's maps and results."""

    @classmethod
    def of(cls, plan: RunPlan, folder: Path) -> "RunFiles":
        """Return the paths of a plan's files below a folder."""
        place = folder / "-".join([Path(plan.scene).stem, *drive_conditions(plan.conditions), str(plan.seed)])
        return cls(plan, place, place / plan.label)

    @property
    def drive(self) -> Path:
        """Path of the recording of the mapping drive."""
        return self.folder / "drive.rrd"

    @property
    def drive_truth(self) -> Path:
        """Path of the exact poses of the drive's images."""
        return self.folder / "drive.json"

    @property
    def weights(self) -> Path:
        """Path of the weights: those that are fine-tuned on the drive, or else those that the system begins with."""
        if not self.plan.finetuned:
            return self.plan.start_weights
        return self.folder / f"{network_owner(self.plan.system)}.safetensors"

    @property
    def world_queries(self) -> Path:
        """Path of the queries in a changing world, which all maintenances share, with what is closed at each."""
        return self.folder / f"{self.plan.static_label}-{self.plan.schedule.label}.json"

    def map(self, queries: int = 0) -> Path:
        """Return the path of the map after a number of queries."""
        return self.run / f"map-{queries:04d}.rrd"

    def map_row(self, queries: int = 0) -> Path:
        """Return the path of the line about the map after a number of queries."""
        return self.map(queries).with_suffix(".jsonl")

    def drawing(self, queries: int = 0) -> Path:
        """Return the path of the drawing of the map after a number of queries."""
        return drawing_path(self.run, queries)

    def episodes(self, queries: int, first: int) -> Path:
        """Return the path of the lines about the batch of episodes from `first`, with the map after a number of
        queries."""
        return self.run / f"episodes-{queries:04d}-{first:04d}.jsonl"

    def query_batch(self, first: int, until: int) -> Path:
        """Return the path of the lines about the queries from `first` up to `until`."""
        return self.run / f"queries-{first:04d}-{until:04d}.jsonl"

    def failure(self, episode: int) -> Path:
        """Return the path of the recording of a failed episode."""
        return failure_path(self.run, episode)


def claim_files(files: RunFiles) -> None:
    """Write the settings of a plan beside its files. Raises OptionError if the files have other settings.

    The number of episodes is not compared, because the first ones stay the same; without a world, nor are the number of
    queries and the interval of the tests. The drive and the weights have their own settings, because other methods also
    use them.
    """
    from ltvn_core.network.weights_file import weights_fingerprint

    plan = files.plan
    refuse_older_results(files.run, ("plan.json",))
    weights = weights_fingerprint(plan.start_weights)
    settings = plan_settings(plan)
    protocol = settings["protocol"]
    drive = {"scene": plan.scene, "seed": plan.seed}
    drive |= {
        name: protocol[name]
        for name in ("loops", "goals", "distance_noise", "angle_noise", "slips_per_m", "body")
        if name in protocol
    }
    learned = {"weights": weights, "finetune_steps": plan.finetune_steps if plan.finetuned else 0}
    claim_settings(files.drive_truth.with_suffix(".plan.json"), drive)
    if plan.finetuned:
        claim_settings(files.weights.with_suffix(".plan.json"), learned)
    claim_settings(files.run / "run.json", settings | learned)
    if plan.schedule.world:  # All maintenances share the queries.
        claim_settings(files.world_queries.with_suffix(".plan.json"), settings | {"maintenance": "any"})


def plan_settings(plan: RunPlan) -> dict[str, Any]:
    """Return the stored settings of a plan: all that its results depend on, except the number of episodes.

    Slips, body and device are left out at their defaults, because drives of older versions do not name them.
    """
    settings: dict[str, Any] = asdict(plan) | {"version": version("ltvn")}
    if plan.device == "cpu":
        del settings["device"]
    protocol = settings["protocol"]
    del protocol["episodes"]
    protocol["body"] = body = choose_body(plan.protocol.body)
    if not plan.protocol.slips_per_m:
        del protocol["slips_per_m"]
    if body == "bullet":
        del protocol["body"]
    if plan.schedule.world is None:
        settings["schedule"] = plan.schedule.label if plan.schedule.queries else "static"
    elif (script := Path(plan.schedule.world)).is_file():
        settings["script"] = script.read_text(encoding="utf-8")
    return settings


def refuse_older_results(folder: Path, names: Iterable[str]) -> None:
    """Raise OptionError if a folder has files of older versions, which kept results as JSON objects of three kinds."""
    if older := next((path for name in names for path in sorted(folder.glob(name))), None):
        raise OptionError(
            f"{older} was made by an older version of ltvn, and results are read from {ROWS} now; evaluate again with "
            "another --folder, or move this one away."
        )


def _settings_in(path: Path) -> Mapping[str, Any]:
    try:
        found = parse_json(path.read_text(encoding="utf-8"))
        if not isinstance(found, dict):
            raise ValueError("it is not a JSON object")
    except ValueError as error:
        raise OptionError(f"{path} contains no settings ({error}); name another --folder, or move it away.") from error
    return found


def claim_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Write settings to a file beside the results. Raises OptionError if it holds other settings."""
    made_by = json.loads(json.dumps(settings, default=str))
    if not path.exists():
        write_text_atomically(path, json.dumps(made_by, indent=1))
    before = _settings_in(path)
    if changed := sorted(key for key in made_by.keys() | before.keys() if made_by.get(key) != before.get(key)):
        raise OptionError(
            f"{path.parent} holds results that were made with other settings ({', '.join(changed)}). Name another "
            "--folder, or move that one away."
        )
