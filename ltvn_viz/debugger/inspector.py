"""The inspector: the current question, the selection, and the answer to show.

Owns this state, the refresh of the answer, and its context: the live run or an open recording. Implements
`ltvn_viz.session.app_state.Debugger`; runs in the session's thread.
"""

import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from ltvn_core.analysis.answer import Answer, Paragraph
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph.presence.edge_presence import FilteredPresence
from ltvn_core.types import FrameId, NodeId, Observation
from ltvn_viz.debugger.answer_html import answer_html
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.file_context import replay_context
from ltvn_viz.debugger.question import Question
from ltvn_viz.session.activities.playback import Playback, ReplayMethod
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.inspection import (
    LINKS_PER_VIEW,
    NO_ANSWER,
    Inspection,
    QuestionAnswer,
    QuestionName,
    Selection,
)
from ltvn_viz.session.worker import Worker
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.wishes.commands import Command, QuestionRequest

_COUNT_EVERY_S = 1.0
"""Shortest time between counts of the events of a run, in seconds, because each count refreshes the answers."""


def _live_observation(state: AppState) -> Callable[[FrameId], Observation | None]:
    def observation(frame: FrameId) -> Observation | None:
        if state.live.observation is not None and state.live.observation.step == frame:
            return state.live.observation
        try:
            return state.live_map.keyframes.observation(frame)
        except LtvnError:
            return None

    return observation


_REMEMBERED = 100
"""Number of recent views whose links still work, because a page may lag behind, and an answer may be replaced just
before a person clicks."""


class Inspector:
    """The debugger's state."""

    def __init__(self, questions: Sequence[Question[Any]], worker: Worker) -> None:
        """Offer these questions in this order, and let them compute slow answers in `worker`."""
        self._questions: dict[str, Question[Any]] = {question.name: question for question in questions}
        self.words = {
            word: question.name for question in questions for word in (question.word, *question.earlier_words)
        }
        self._in_background = BackgroundCache(worker.submit, self.mark_stale)
        self._run: Timeline | None = None
        self._known_events = 0
        self._due = float("-inf")
        self.shown = Inspection(abouts={question.name: question.about for question in questions})
        self._key: object = None
        self._context: DebugContext | None = None
        self._drawn: OrderedDict[int, tuple[Command, ...]] = OrderedDict()

    @property
    def is_on(self) -> bool:
        """Whether a person asked a question, so that clicks on the map are for it."""
        return self.shown.question != QuestionName.FIRST

    def choose(self, question: str) -> None:
        """Show a question."""
        chosen = self._questions.get(question)
        verb = "" if chosen is None else chosen.verb
        self.shown = replace(
            self.shown,
            question=question,
            verb=verb,
            answer=NO_ANSWER,
            markup="",
            serial=self.shown.serial + 1,
        )
        self._in_background.leave()
        self._drawn.clear()
        self._key = None

    def point_at(self, node: NodeId, target: NodeId | None = None) -> None:
        """Select a node, or the edge from it to `target`; if an edge leads to it from the node selected before, select
        that edge."""
        first = self.shown.selection.node
        if target is not None:
            selection = Selection(None, (node, target))
        elif first is not None and self._context is not None and (first, node) in self._context.graph.edges:
            selection = Selection(node, (first, node), first)
        else:
            selection = Selection(node, before=first if first != node else self.shown.selection.before)
        self.shown = replace(self.shown, selection=selection)

    def handle_text(self, text: str) -> Command | None:
        """Pass typed text to the question; return the request, if any. Raises OptionError, MapError."""
        question, context = self._asked()
        return question.handle_text(context, text)

    def handle_request(self, request: QuestionRequest) -> Command | None:
        """Pass the request of a link to its question; return its command for the session, if any. Raises LtvnError."""
        question, context = self._asked()
        return question.handle_request(context, request)

    def _asked(self) -> tuple[Question[Any], DebugContext]:
        question = self._questions.get(self.shown.question)
        if question is None or self._context is None:
            raise OptionError("Choose a question first.")
        self._key = None
        return question, self._context

    def context(self, state: AppState, moment: RunMoment) -> DebugContext:
        """Return the context of questions when the page shows `moment`."""
        if isinstance(activity := state.activity, Playback):
            robots = ReplayMethod(state.live_map.predictor, state.live_map.system.method)
            return replay_context(
                activity,
                moment,
                lambda: activity.method or robots,
                known_events=self._count(activity.timeline),
                live=state.live.timeline,
                in_background=self._in_background,
                library=state.library,
                rerun=state.rerun,
                offer_file=state.saved_files.offer,
                floor_plan=None if state.alignment is None else state.alignment.view.plan,
            )
        run = state.live.timeline
        live_map = state.live_map
        presence = live_map.system.presence
        return DebugContext(
            name="",
            scene=state.scene,
            start_s=run.start_s,
            moment=moment,
            step=run.instant_at(moment.stamp).step,
            timeline=run,
            known_events=self._count(run),
            observation=_live_observation(state),
            camera=state.live.robot.spec.camera,
            comparison=lambda: ReplayMethod(live_map.predictor, live_map.system.method),
            weights=live_map.fingerprint,
            system=live_map.system.name,
            presence_filter=presence.presence_filter if isinstance(presence, FilteredPresence) else None,
            live_map=live_map,
            live=run,
            in_background=self._in_background,
            library=state.library,
            rerun=state.rerun,
            offer_file=state.saved_files.offer,
        )

    def _count(self, run: Timeline) -> int:
        if run is not self._run or (len(run.events) != self._known_events and time.monotonic() > self._due):
            self._run = run
            self._known_events = len(run.events)
            self._due = time.monotonic() + _COUNT_EVERY_S
        return self._known_events

    def refresh(self, state: AppState, moment: RunMoment) -> None:
        """Refresh the answer if anything changed that it may show."""
        question = self._questions.get(self.shown.question)
        self._context = context = self.context(state, moment)
        questions = self._questions.values()
        offered = tuple(each.name for each in questions if each.is_offered(context) or each is question)
        if offered != self.shown.offered:
            self.shown = replace(self.shown, offered=offered)
        run = context.name, context.timeline, context.known_events
        key = self.shown.question, self.shown.selection, run, context.step
        if question is None or key == self._key:
            return
        self._key = key
        try:
            answer = question.answer(context, self.shown.selection)
        except LtvnError as error:
            answer = QuestionAnswer(Answer((Paragraph((str(error),)),)))
        if answer != self.shown.answer:
            markup = answer_html(answer.answer)
            self.shown = replace(self.shown, answer=answer, markup=markup, serial=self.shown.serial + 1)
            self._drawn[self.shown.serial] = self.shown.answer.links
            if len(self._drawn) > _REMEMBERED:
                self._drawn.popitem(last=False)

    def mark_stale(self) -> None:
        """Let the question refresh its answer although no event happened, because there is new information."""
        self._key = None

    def take_in_all_events(self) -> None:
        """Include the latest events in the answers, because a person waits to see a change."""
        self._due = float("-inf")

    def link(self, number: int) -> Command | None:
        """Return the request of a drawn link; None if it belongs to another question, or is too old."""
        serial, place = divmod(number, LINKS_PER_VIEW)
        links = self._drawn.get(serial, ())
        return links[place] if place < len(links) else None
