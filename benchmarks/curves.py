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
from typing import Annotated

import tyro

from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

Costs = dict[str, float]
"""Numbers of one point by name with unit."""
_FALSE_OF_CLOSURES = 6 / 17
_IMAGES_AT_ONCE = 560
_BANDWIDTH_BYTES = 2**29
_VECTORS = 100_000


def look(nodes: str) -> Costs:
    """Time a look of a robot that does not know where it is."""
    from benchmarks.localising import lost_look_s

    return {"a look, ms": 1e3 * lost_look_s(int(nodes))}


def correct(poses: str) -> Costs:
    """Time the correction of a drive, with closures for every fourth pose, of which a third is false."""
    from benchmarks.pose_graph import correction_s

    closures = round(int(poses) * 17 / 60)
    false = round(closures * _FALSE_OF_CLOSURES)
    return {"time, s": correction_s(int(poses), closures - false, false)}


def build(images: str) -> Costs:
    """Time the building of a map."""
    from benchmarks.matching import build_s

    spent_s = build_s(int(images))
    return {"time, s": spent_s, "images a second": int(images) / spent_s}


def build_two(images: str) -> Costs:
    """Build two maps at the same time, each in its process."""
    command = [sys.executable, "-m", "benchmarks.curves", build.__name__, images]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
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


JOBS: Mapping[str, Callable[[str], Costs]] = {
    job.__name__: job for job in (look, correct, build, build_two, record, limits)
}
POINTS = (
    *((look.__name__, nodes) for nodes in ("1000", "10000", "100000")),
    *((correct.__name__, poses) for poses in ("750", "1500", "3000", "6000")),
    *((build.__name__, images) for images in ("280", "560", "1120", "2240")),
    (build_two.__name__, str(_IMAGES_AT_ONCE)),
    *((record.__name__, hours) for hours in ("0.5", "1", "8")),
    (limits.__name__, ""),
)
TITLES = {
    "look": "localise a lost robot: nodes",
    "correct": "correct a drive by closures, a third of them false: poses",
    "build": "build a map: images",
    "build_two": "two builds at a time: images of each",
    "record": "a recording: hours",
    "limits": "the machine itself",
}


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

        from ltvn_core.evaluation.reports.evaluation_page import fill_blocks

        self.folder.mkdir(parents=True, exist_ok=True)
        points = {(job, size): self._point(job, size) for job, size in tqdm(POINTS, desc="measure", unit="point")}
        if self.page is not None:
            fill_blocks(self.page, {"curves": "\n".join(_tables(points)).strip()})
        return CurvesSummary({f"{job} {size}".strip(): costs for (job, size), costs in points.items()})

    def _point(self, job: str, size: str) -> Costs:
        kept = self.folder / f"{job}-{size}.json"
        if not kept.exists():
            command = [sys.executable, "-m", "benchmarks.curves", job, size]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
            kept.write_bytes(done.stdout)
        return json.loads(kept.read_text(encoding="utf-8"))


def _tables(points: Mapping[tuple[str, str], Costs]) -> Iterator[str]:
    """Yield the lines of a table for each job, with a column for each size."""
    for job, title in TITLES.items():
        columns = [(size, costs) for (name, size), costs in points.items() if name == job]
        sizes = [f"{float(size):,g}" if size else "" for size, _ in columns]
        yield from ("", f"| {title} | {' | '.join(sizes)} |", "|---" * (len(columns) + 1) + "|")
        for name in columns[0][1]:
            yield f"| {name} | {' | '.join(_rounded(costs[name]) for _, costs in columns)} |"


def _rounded(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.2g}"


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] in JOBS:
        sys.stdout.write(json.dumps(JOBS[sys.argv[1]](sys.argv[2])))
    else:
        sys.exit(run_verb("python -m benchmarks.curves", CurvesVerb))
