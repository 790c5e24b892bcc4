"""`python -m benchmarks.curves`: how the costs grow with the size of map, drive and recording.

Each point is measured in a process of its own and kept in the folder, so that the command goes on where it was
interrupted. Owns the sizes, and the table.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

Costs = dict[str, float]
"""Numbers of one point by name with unit."""
_BANDWIDTH_BYTES = 2**29
_VECTORS = 100_000


def look(nodes: str) -> Costs:
    """Time a look of a robot that does not know where it is."""
    from benchmarks.localising import lost_look_s

    return {"a look, ms": 1e3 * lost_look_s(int(nodes))}


def correct(poses: str) -> Costs:
    """Time the correction of a drive, with closures for every fourth pose, of which a third is false."""
    from benchmarks.pose_graph import FALSE, POSES, TRUE, correction_s

    share = int(poses) / POSES
    return {"time, s": correction_s(int(poses), round(share * TRUE), round(share * FALSE))}


def build(images: str) -> Costs:
    """Time the building of a map."""
    from benchmarks.matching import build_s

    spent_s = build_s(int(images))
    return {"time, s": spent_s, "images a second": int(images) / spent_s}


def build_two(images: str) -> Costs:
    """Build two maps at the same time, each in its process."""
    both = [subprocess.Popen(_command(build.__name__, images), stdout=subprocess.PIPE) for _ in range(2)]
    rates = [json.loads(each.communicate()[0])["images a second"] for each in both]
    return {"images a second": sum(rates)}


def record(hours: str) -> Costs:
    """Open, question and verify a long recording."""
    from benchmarks.long_recording import LongRecordingSummary, LongRecordingVerb

    found = LongRecordingVerb(hours=float(hours)).run()
    assert isinstance(found, LongRecordingSummary)
    return {f"{row.name}, {row.unit}": row.value for row in found.measurements}


def limits(_: str) -> Costs:
    """Measure the machine itself: copying memory, and an exhaustive search as FAISS's flat index does it."""
    import numpy as np

    from benchmarks.measurement import seconds
    from ltvn_core.network.architecture import PairArchitecture

    source = np.ones(_BANDWIDTH_BYTES // 4, np.float32)
    target = np.empty_like(source)
    copied_s = seconds(lambda: np.copyto(target, source), 5)
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(_VECTORS, PairArchitecture().place)).astype(np.float32)
    searched_s = seconds(lambda: np.argmax(vectors @ vectors[0]), 21)
    return {
        "memory copied, GB/s": 2 * _BANDWIDTH_BYTES / copied_s / 1e9,
        f"a place vector against {_VECTORS:,}, ms": 1e3 * searched_s,
    }


class Curve(NamedTuple):
    """One job at several sizes."""

    job: Callable[[str], Costs]
    title: str
    sizes: tuple[str, ...]


CURVES = (
    Curve(look, "localise a lost robot: nodes", ("1000", "10000", "100000")),
    Curve(correct, "correct a drive by closures, a third of them false: poses", ("750", "1500", "3000", "6000")),
    Curve(build, "build a map: images", ("280", "560", "1120", "2240")),
    Curve(build_two, "two builds at a time: images of each", ("560",)),
    Curve(record, "a recording: hours", ("0.5", "1", "8")),
    Curve(limits, "the machine itself", ("",)),
)
JOBS = {curve.job.__name__: curve.job for curve in CURVES}


def _command(job: str, size: str) -> list[str]:
    return [sys.executable, "-m", "benchmarks.curves", job, size]


@dataclass(frozen=True)
class CurvesSummary:
    """All points that are measured."""

    points: dict[str, Costs]


@dataclass(frozen=True, kw_only=True)
class CurvesVerb(Verb):
    """Measure all points that the folder does not have; takes twenty minutes, and more to write recordings."""

    folder: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/curves")
    """Where the points are kept, and found again by the next call."""
    page: Path | None = None
    """Write the table into this Markdown page, between the lines of its block `curves`."""

    def run(self) -> Summary:
        """Measure what is missing, and sum up."""
        from tqdm import tqdm

        from tools.results_page import fill_blocks

        self.folder.mkdir(parents=True, exist_ok=True)
        wanted = [(curve.job.__name__, size) for curve in CURVES for size in curve.sizes]
        points = {(job, size): self._point(job, size) for job, size in tqdm(wanted, desc="measure", unit="point")}
        if self.page is not None:
            fill_blocks(self.page, {"curves": "\n".join(_tables(points)).strip()})
        return CurvesSummary({f"{job} {size}".strip(): costs for (job, size), costs in points.items()})

    def _point(self, job: str, size: str) -> Costs:
        kept = self.folder / f"{job}-{size}.json"
        if not kept.exists():
            done = subprocess.run(_command(job, size), check=True, stdout=subprocess.PIPE)
            kept.write_bytes(done.stdout)
        return json.loads(kept.read_text(encoding="utf-8"))


def _tables(points: Mapping[tuple[str, str], Costs]) -> Iterator[str]:
    """Yield the lines of a table for each job, with a column for each size."""
    for curve in CURVES:
        columns = [points[curve.job.__name__, size] for size in curve.sizes]
        sizes = [f"{float(size):,g}" if size else "" for size in curve.sizes]
        yield from ("", f"| {curve.title} | {' | '.join(sizes)} |", "|---" * (len(columns) + 1) + "|")
        for name in columns[0]:
            yield f"| {name} | {' | '.join(_rounded(costs[name]) for costs in columns)} |"


def _rounded(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] in JOBS:
        sys.stdout.write(json.dumps(JOBS[sys.argv[1]](sys.argv[2])))
    else:
        sys.exit(run_verb("python -m benchmarks.curves", CurvesVerb))
