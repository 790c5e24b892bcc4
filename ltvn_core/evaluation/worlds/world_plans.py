"""Plans of evaluations in a changing world, and the paths of their files.

All maintenances share drive, weights, first map, script and queries. Runs nothing.
"""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world_script import DAY_S, MORNING_S, WorldScript
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import CONTROL_STEP_S

WEEK_DAYS = 7.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldPlan:
    """One maintenance in one changing scene with one map seed."""

    trial: TrialPlan
    """Scene, seed and method."""
    world: str
    """Name of a script, or the path of its file."""
    maintenance: str
    """What driving teaches the map, by name."""
    queries: int = 700
    days: float = WEEK_DAYS
    """Over so many simulated days the queries are spread, evenly."""

    def __post_init__(self) -> None:
        if self.queries < 1 or not 0 < self.days <= 365:
            raise OptionError(
                "Give one query or more, and more than 0 and at most 365 days, got "
                f"{self.queries} queries in {self.days:g} days."
            )
        longest_s = self.trial.protocol.steps_in(load_scene(self.trial.scene)) * CONTROL_STEP_S
        if self.slot_s < 2 * longest_s:
            raise OptionError(
                f"{self.queries} queries in {self.days:g} days leave {self.slot_s:.0f} s for each, and one may take "
                f"{longest_s:.0f} s; {2 * longest_s:.0f} s are needed. Give more --days or fewer --queries."
            )

    @property
    def slot_s(self) -> float:
        """Seconds from one query to the next, on average."""
        return self.days * DAY_S / self.queries

    def script(self, scene: Scene) -> WorldScript:
        """Return what happens in the world. Raises WorldError."""
        until_s = MORNING_S + self.days * DAY_S
        return make_script(self.world, scene, seed=self.trial.seed, duration_s=until_s)


@dataclass(frozen=True, slots=True)
class WorldFiles:
    """The paths of the files of a plan."""

    trial: TrialFiles
    """Drive, weights and first map, which do not depend on the maintenance."""
    world: Path
    """Folder of the script and the queries."""
    maintenance: str

    @classmethod
    def of(cls, plan: WorldPlan, trial: TrialFiles) -> "WorldFiles":
        """Name the files of a plan beside those of its trial without maintenance."""
        folder = f"world-{Path(plan.world).stem}-{plan.queries}-in-{plan.days:g}-days"
        return cls(trial, trial.folder / trial.label / folder, plan.maintenance)

    @property
    def settings(self) -> Path:
        """What the script and the queries were made with."""
        return self.world / "plan.json"

    @property
    def schedule(self) -> Path:
        """Queries, and which edges are closed when they begin."""
        return self.world / "schedule.json"

    def map(self, queries: int) -> Path:
        """Return the map after so many queries."""
        return self.world / self.maintenance / f"map-{queries:04d}.rrd" if queries else self.trial.map()

    def query_batch(self, first: int, until: int) -> Path:
        """Return the results of the queries from `first` up to `until`."""
        return self.world / self.maintenance / f"queries-{first:04d}-{until:04d}.json"

    @property
    def result(self) -> Path:
        """All results of this maintenance."""
        return self.world / f"{self.maintenance}.world.json"
