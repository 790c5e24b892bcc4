"""Run in an environment of one extra: replays a recording and asks every question of the debugger.

`python debug_recording.py FILE.rrd...` prints for each file its questions with the texts of their answers as JSON; it
imports nothing of the tests, for these are not there.
"""

import html
import json
import re
import sys
from contextlib import ExitStack
from pathlib import Path

from ltvn_core.types import NodeId
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.goals import ThumbnailStore
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c

TICKS = 4


class NoDriver:
    """Nobody drives a recording."""

    def current_twist(self) -> None:
        """Say nothing."""

    def keep(self, *, kept: bool) -> None:
        """There is no seat."""


def main(recording: Path) -> dict[str, str]:
    """Return the answer to every question in plain text, at the end of the recording with an edge selected."""
    with ExitStack() as stack:
        options = AppOptions(recordings=recording.parent, replay=recording.name, scene="demo")
        state = open_app_state(options, stack, ThumbnailStore())
        shown: list[Snapshot] = []
        session = Session(state, NoDriver(), shown.append)
        stack.callback(session.close)

        def act(*commands: c.Command) -> Snapshot:
            for each in commands:
                session.send(each)
            for _ in range(TICKS):
                session.tick()
                state.worker.settle()
            return shown[-1]

        opened = act(c.OpenRecording(recording.name))
        assert opened.replay is not None, opened.message
        opened = act(c.Seek(1e9))
        answers = {}
        for question in opened.inspection.offered:
            if question != QuestionName.NONE:
                answers[question] = _text(act(c.Ask(c.Action.QUESTION, question), *_one_edge(opened)))
    return answers


def _one_edge(snapshot: Snapshot) -> list[c.Command]:
    """Point at the first edge of the map, if it has one."""
    return [c.PointAt(NodeId(source), NodeId(target)) for source, target in list(snapshot.moment.graph.edges)[:1]]


def _text(snapshot: Snapshot) -> str:
    said = "" if snapshot.message is None else f" [{snapshot.message.text}]"
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", snapshot.inspection.html))).strip() + said


if __name__ == "__main__":
    sys.stdout.write(json.dumps([main(Path(each)) for each in sys.argv[1:]], ensure_ascii=True, indent=1))
