"""`python -m benchmarks`: the budgets of docs/performance.md, measured on this machine."""

import os
import platform
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from benchmarks.measurement import Measurement


@dataclass(frozen=True)
class BenchSummary:
    """All measured budgets."""

    machine: str
    measurements: "list[Measurement]"


@dataclass(frozen=True, kw_only=True)
class BenchVerb(Verb):
    """Measure the speed budgets of docs/performance.md; takes about ten minutes."""

    only: str | None = None
    """Measure only those whose module bears this name, for instance planning."""

    def run(self) -> Summary:
        """Measure one budget after the other."""
        from tqdm import tqdm

        from benchmarks import (
            camera,
            drive_latency,
            learning,
            localising,
            long_replay,
            matching,
            planning,
            pose_graph,
            recorder,
            recording,
            world_change,
        )

        jobs = {
            "camera": camera.render_large_mesh,
            "debugger": long_replay.open_and_travel,
            "driving": drive_latency.key_to_command,
            "wheels": drive_latency.key_to_wheel,
            "learning": learning.learn,
            "localising": localising.localise,
            "matching": matching.build_map,
            "planning": planning.plan_large_map,
            "pose_graph": pose_graph.correct_long_drive,
            "recorder": recorder.begin_and_fail,
            "recording": recording.write_and_read,
            "world_change": world_change.change_worlds,
        }
        chosen = {name: job for name, job in jobs.items() if self.only in (None, name)}
        rows = [row for job in tqdm(chosen.values(), desc="bench") for row in job()]
        return BenchSummary(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}", rows)


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks", BenchVerb))
