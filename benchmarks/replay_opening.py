"""What it costs to open a long recording from disk until the first picture is on its way; one of the benchmarks.

Owns the measuring: the file, made up but written as any other, and a page that receives what is drawn. How fast a
browser draws it is not measured.
"""

import itertools
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from websockets.sync.connection import Connection

from benchmarks.drive_latency import EDGES, NODES, page_socket
from benchmarks.measurement import Measurement, measured
from benchmarks.recording import demo_observations
from benchmarks.synthetic_run import EVENTS, synthetic_run
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_viz.layers.graph_layers import EDGE_WIDTHS, EdgesLayer, NodesLayer
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.session.activities.playback import Playback, open_replay
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.snapshot import Snapshot

_FRAME_EVERY = 5
"""Of the events that were lived, one in so many has an image of its own; the map's nodes all have one."""
_PICTURES = 20
_QUIET_S = 2.0
"""A page that hears nothing for so long has heard all."""


@dataclass(frozen=True, slots=True)
class _Cost:
    wall_s: float
    processor_s: float


def open_from_disk() -> list[Measurement]:
    """Open 50,000 events on a map of 10,000 nodes and 50,000 edges, draw them, and recolour the map."""
    with tempfile.TemporaryDirectory() as folder, GuardedServer() as server:
        path = Path(folder) / "long.rrd"
        write_long_run(path)
        page = _HeadlessPage(server)
        opened, replay = _costs(lambda: page.first_picture(path))
        size_kb = page.recolour_bytes(replay) / 1e3
    name = f"open {EVENTS:,} events on {NODES:,} nodes and {EDGES:,} edges from disk to the first picture"
    return [
        measured(f"{name}, processor time", opened.processor_s, "s", at_most=3),
        measured(f"{name}, on the clock", opened.wall_s, "s", at_most=3),
        measured(f"recolour {EDGES:,} edges", size_kb, "kB", at_most=400),
    ]


def write_long_run(path: Path) -> None:
    """Write the made-up run with its images; takes more than a minute."""
    pictures = itertools.cycle(demo_observations(_PICTURES))
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        for node in range(NODES):
            writer.write_frame(replace(next(pictures), step=node, stamp=0.0))
        for count, stamped in enumerate(synthetic_run()):
            stamped = stamped._replace(step=NODES - 1 + stamped.step)
            writer.write_event(stamped)
            if stamped.step >= NODES and count % _FRAME_EVERY == 0:
                writer.write_frame(replace(next(pictures), step=stamped.step, stamp=stamped.stamp))


class _HeadlessPage:
    """The map's layers, without a window around them."""

    def __init__(self, server: GuardedServer) -> None:
        self._server = server
        late = itertools.count(0.0, 10.0)  # No picture is held back for coming too soon after another.
        self._nodes = NodesLayer(server.scene)
        self._edges = EdgesLayer(server.scene, clock=lambda: next(late))

    def first_picture(self, path: Path) -> Playback:
        """Open a recording and draw the end of it."""
        replay = open_replay(RecordingLibrary(path.parent), path.name)
        replay.seek(replay.length_s)
        self._draw(replay)
        return replay

    def recolour_bytes(self, replay: Playback) -> int:
        """Return how much a page receives when all beliefs change, each so little that no edge changes its width."""
        moment = replay.moment()
        p = moment.graph.p
        mirrored = (2 * np.floor(len(EDGE_WIDTHS) * p) + 1) / len(EDGE_WIDTHS) - p
        moment = replace(moment, graph=replace(moment.graph, p=mirrored))
        with page_socket(self._server, "/", "viser-v1.1.1") as socket:
            _received(socket)
            self._show(Snapshot(moment=moment))
            return _received(socket)

    def _draw(self, replay: Playback) -> None:
        moment = replay.moment()
        self._show(Snapshot(moment=moment, camera=replay.camera(moment.frame)))

    def _show(self, snapshot: Snapshot) -> None:
        with self._server.viser.atomic():
            self._nodes.show(snapshot)
            self._edges.show(snapshot)
        self._server.viser.flush()


def _received(socket: Connection) -> int:
    """Return how many bytes come until nothing more does."""
    size = 0
    while True:
        try:
            size += len(socket.recv(timeout=_QUIET_S))
        except TimeoutError:
            return size


def _costs(job: Callable[[], Playback]) -> tuple[_Cost, Playback]:
    wall, processor = time.perf_counter(), time.process_time()
    done = job()
    return _Cost(time.perf_counter() - wall, time.process_time() - processor), done
