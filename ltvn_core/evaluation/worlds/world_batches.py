"""Runs queries in a changing world in batches; each batch starts with the map that the one before it saved.

A finished batch is two files, the map and the results of its queries, so an interrupted test continues at the last map.
Frame numbers, random generators and the world depend on the number of the query only, so interruptions do not change
results.
"""

import time

from ltvn_core.evaluation.query_result import QueryBatch
from ltvn_core.evaluation.results import load_results, save_results
from ltvn_core.evaluation.worlds.world_drive import WorldDrive
from ltvn_core.evaluation.worlds.world_plans import WorldFiles, WorldPlan

QUERIES_PER_BATCH = 25
"""Queries in a batch: few are lost by an interruption, and the map is not loaded too often."""


def batch_ranges(queries: int) -> list[tuple[int, int]]:
    """Return the first query of each batch, and the one after its last."""
    return [(first, min(first + QUERIES_PER_BATCH, queries)) for first in range(0, queries, QUERIES_PER_BATCH)]


def run_world_batches(plan: WorldPlan, files: WorldFiles) -> int:
    """Drive all queries of a plan that are not driven yet; return their number."""
    for first, until in batch_ranges(plan.queries):
        run_world_batch(plan, files, first, until)
    return plan.queries


def load_batches(plan: WorldPlan, files: WorldFiles) -> list[QueryBatch]:
    """Read the results of all queries. Raises OptionError if some are missing."""
    return [load_results(files.batch(*each), QueryBatch) for each in batch_ranges(plan.queries)]


def run_world_batch(plan: WorldPlan, files: WorldFiles, first: int, until: int) -> None:
    """Drive the queries from `first` up to `until`, starting with the map after `first` queries.

    Writes the map and the results; does nothing if both files exist.
    """
    if files.batch(first, until).exists() and files.map(until).exists():
        return
    started = time.monotonic()
    drive = WorldDrive(plan, files, first)
    queries = tuple(drive.run(query) for query in range(first, until))
    if not files.map(until).exists():
        drive.save_map(until)
    if not files.batch(first, until).exists():
        save_results(files.batch(first, until), QueryBatch(queries, time.monotonic() - started))
