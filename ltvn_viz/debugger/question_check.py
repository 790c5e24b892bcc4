"""The check of a question of another package: it is asked about the demo recording."""

from functools import partial
from importlib.metadata import EntryPoint
from typing import Any

from ltvn_core.data.recording.demo_files import DEMO_RECORDING, demo_file
from ltvn_core.errors import RecordingError
from ltvn_core.plugins import QUESTIONS, Plugin
from ltvn_viz.debugger.file_context import FileCase, JobsAtOnce
from ltvn_viz.debugger.question_registry import make_question
from ltvn_viz.session.inspection import Selection


def ask_about_demo(make: Any) -> None:
    """Ask a question at the end of the demo recording, without and with a selection. Raises what the question
    raises."""
    name = getattr(make, "__qualname__", repr(make))
    question = make_question(Plugin(QUESTIONS, EntryPoint(name, f"{make.__module__}:{name}", QUESTIONS.name)), make)
    path = demo_file(DEMO_RECORDING)
    if path is None:
        raise RecordingError(f"{DEMO_RECORDING} is missing; reinstall the toolkit: pip install ltvn (or -e .)")
    case = FileCase(path)
    jobs = JobsAtOnce()
    context = case.context(case.replay.length_s, jobs)
    edge = next(iter(context.graph.edges))
    for selection in (Selection(), Selection(node=edge[0]), Selection(edge=edge)):
        answer = jobs.complete(partial(question.sound_answer, context, selection))
        assert not answer.is_pending, f"its answer to {selection} is never complete"
        assert answer.answer.blocks, f"its answer to {selection} is empty"
