"""`ltvn plant`: puts faults into a good map, and runs queries that meet them, to practise with the debugger and to test
it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from tyro.conf import Positional

from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, PredictorName
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Verb

FaultName = Literal["spurious-edge", "look-alike", "missing-edge"]


@dataclass(frozen=True, kw_only=True)
class PlantVerb(Verb):
    """Put faults into a simulated map, and record a query that meets each of them, as exercises for the debugger.

    The map's reserve is left out, so that maintenance cannot repair the map with it.
    """

    job = "ltvn_core.verbs.jobs.plant:plant_faults"

    map: Positional[Path]
    """A map of a simulated scene; it is read, never changed."""
    recording: NewRecording
    """The recording to write; it begins with the faulty map. Must not exist yet."""
    fault: tyro.conf.UseAppendAction[tuple[FaultName, ...]] = ()
    """Fault to insert; may be given several times. There is one query for each fault in the same order, so that a
    repeated fault is met twice. By default, all three are inserted and the first is met twice."""
    edges: int = 1
    """Number of spurious edges to insert, each with its own queries."""
    rounds: int = 1
    """Number of times that all queries are driven."""
    maintenance: MaintenanceName | None = None
    """How driving updates the map; by default as in the map's system."""
    steps: int = 80
    """Number of control steps of 0.1 s after which a query ends."""
    predictor: PredictorName = AUTO
    """Predictor that compares images; must be the one that built the map, which auto finds."""
    weights: Path | None = None
    """Weights to use instead of those that come with the map's system; must be those that built the map."""
    seed: int = 0
    """Seed of the noise."""
    body: BodyOption = "auto"

    @property
    def kinds(self) -> tuple[FaultName, ...]:
        """The faults that the queries meet, in order."""
        return self.fault or ("spurious-edge", "spurious-edge", "look-alike", "missing-edge")
