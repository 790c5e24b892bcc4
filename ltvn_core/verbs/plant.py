"""`ltvn plant`: faults in a good map, and queries that meet them, for practice with the debugger and for its tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from tyro.conf import Positional

from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.verb import Verb

FaultName = Literal["spurious-edge", "look-alike", "missing-edge"]


@dataclass(frozen=True, kw_only=True)
class PlantVerb(Verb):
    """Plant faults in a simulated map and record a query that meets each: something to find for a debugger.

    The map's reserve is left out, so that the map cannot be repaired with it.
    """

    job = "ltvn_core.verbs.jobs.plant:plant_faults"

    map: Positional[Path]
    """A map of a simulated scene; it is read, never changed."""
    recording: Path
    """The recording to write; it begins with the faulty map. Must not exist yet."""
    fault: tyro.conf.UseAppendAction[tuple[FaultName, ...]] = ()
    """Fault to plant; may be given several times. There is one query for each fault in the same order, so a fault that
    is given twice is met twice. If not given, all three are planted and the first is met twice.
    """
    edges: int = 1
    """Number of spurious edges to plant, each with its own queries."""
    rounds: int = 1
    """All queries are driven so often."""
    maintenance: MaintenanceName | None = None
    """How driving updates the map; by default as the navigation system of the map says."""
    steps: int = 80
    """Control steps of 0.1 s that end a query."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    seed: int = 0
    """Draws the noise."""
    body: BodyOption = "auto"

    @property
    def kinds(self) -> tuple[FaultName, ...]:
        """Faults that the queries meet, one after the other."""
        return self.fault or ("spurious-edge", "spurious-edge", "look-alike", "missing-edge")
