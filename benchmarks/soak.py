"""`python -m benchmarks.soak`: does the app's memory stay level while it navigates and records for long?

Owns the person who always clicks the next goal, and the curve. The app is the real one, server and painter included.
"""

import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import psutil

from ltvn_core.cli import run_verb
from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_viz.app import RunningApp

SAMPLE_S = 10.0
SETTLING_MIN = 10.0
"""Until then caches fill; the curve is judged from here on."""
HEAD = "minute,rss_mb,recorded_mb,queries,images,nodes,edges"


class SoakSample(NamedTuple):
    """The app at one moment."""

    minute: float
    rss_mb: float
    recorded_mb: float
    queries: int
    images: int
    """Kept for building a map anew."""
    nodes: int
    edges: int

    def line(self) -> str:
        """Return a line of the curve's file."""
        counts = f"{self.queries},{self.images},{self.nodes},{self.edges}"
        return f"{self.minute:.2f},{self.rss_mb:.1f},{self.recorded_mb:.1f},{counts}"


@dataclass(frozen=True)
class SoakSummary:
    """What memory did."""

    curve: Path
    minutes: float
    queries: int
    recorded_mb: float
    settled_rss_mb: float
    """After the first ten minutes, the mean of a minute."""
    last_rss_mb: float
    """The mean of the last minute."""
    growth: float
    """Of the last minute against the settled one; 0.05 is 5 %."""


@dataclass(frozen=True, kw_only=True)
class SoakVerb(Verb):
    """Let the app navigate from goal to goal and record, and write down how much memory it takes."""

    curve: Path
    """The curve to write, as CSV; grows while the app runs. Must not exist yet."""
    minutes: float = 60.0
    """How long to go on."""
    seed: int = 0
    """Draws the goals."""

    def run(self) -> Summary:
        """Soak; raises OptionError, and whatever keeps the app from opening."""
        if self.minutes <= SETTLING_MIN:
            raise OptionError(f"--minutes must be more than {SETTLING_MIN:g}, in which memory settles.")
        samples = list[SoakSample]()
        with (
            self.curve.open("x", encoding="utf-8") as curve,
            tempfile.TemporaryDirectory(prefix="ltvn-soak-") as folder,
        ):
            print(HEAD, file=curve, flush=True)
            for sample in soak(Path(folder), self.minutes, self.seed):
                samples.append(sample)
                print(sample.line(), file=curve, flush=True)
        settled = _mean_rss_mb(samples, SETTLING_MIN, SETTLING_MIN + 1)
        last = _mean_rss_mb(samples, samples[-1].minute - 1, samples[-1].minute)
        return SoakSummary(
            curve=self.curve,
            minutes=samples[-1].minute,
            queries=samples[-1].queries,
            recorded_mb=samples[-1].recorded_mb,
            settled_rss_mb=settled,
            last_rss_mb=last,
            growth=last / settled - 1,
        )


def _mean_rss_mb(samples: Sequence[SoakSample], first_min: float, last_min: float) -> float:
    return float(np.mean([sample.rss_mb for sample in samples if first_min <= sample.minute <= last_min]))


def soak(folder: Path, minutes: float, seed: int) -> Iterator[SoakSample]:
    """Run the app, click a new goal whenever the robot is free, and yield a sample now and then."""
    from ltvn_viz.wishes import commands as c
    from ltvn_viz.wishes.modes import Mode

    rng, process, began = np.random.default_rng(seed), psutil.Process(), time.monotonic()
    due = 0.0
    with running_app(folder) as app:
        app.session.send(c.Ask(c.Action.RECORD))
        while (minute := (time.monotonic() - began) / 60) < minutes:
            graph = app.session.state.live_map.graph
            if app.session.state.activity.mode is Mode.TELEOP:
                app.session.send(c.Ask(c.Action.GOAL, int(rng.choice(list(graph.nodes)))))
            if 60 * minute >= due:
                due += SAMPLE_S
                yield SoakSample(
                    minute=minute,
                    rss_mb=process.memory_info().rss / 1e6,
                    recorded_mb=sum(file.stat().st_size for file in folder.rglob("*.rrd")) / 1e6,
                    queries=app.session.state.queries,
                    images=len(app.session.state.live_map.keyframes.frames),
                    nodes=len(graph.nodes),
                    edges=len(graph.edges),
                )
            time.sleep(0.5)


@contextmanager
def running_app(folder: Path) -> Iterator["RunningApp"]:
    """Open the app on the demo apartment, with its session in a thread, while the block runs."""
    from ltvn_viz.app import AppOptions, open_app
    from ltvn_viz.wishes.commands import Action, Ask

    with ExitStack() as stack:
        app = stack.enter_context(open_app(AppOptions(port=0, recordings=folder)))
        thread = threading.Thread(target=app.session.run, name="session")
        thread.start()
        stack.callback(thread.join)
        stack.callback(app.session.stop)
        app.session.send(Ask(Action.KEEP_GOING, 1))  # There is no page that could be open.
        yield app


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.soak", SoakVerb))
