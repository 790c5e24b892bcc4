"""Share: a link to the current view, an excerpt with a test, the map as page and figure, and a viewer in Rerun."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from shlex import quote
from typing import Any, assert_never

from ltvn_core.analysis.answer import Address, Code, Copyable, Download, Inline, joined
from ltvn_core.errors import LtvnError, OptionError
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.exports import save_excerpt, save_map
from ltvn_viz.debugger.question import AnswerBuilder, Question, request_link
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.share_links import link
from ltvn_viz.wishes.commands import QuestionRequest

_BEFORE_S = 8.0
_AFTER_S = 2.0


class ShareAction(StrEnum):
    """The exports, each with the text of its link."""

    SAVE_EXCERPT = "save this moment"
    SAVE_MAP = "save the map as a page and a figure"
    OPEN_IN_RERUN = "open in Rerun"


@dataclass(frozen=True, slots=True)
class ShareRequest(QuestionRequest):
    """Export the moment on show."""

    action: ShareAction


class ShareQuestion(Question[ShareRequest]):
    """Offers the current view for sharing."""

    name = QuestionName.SHARE
    about = "Share what you see: as a link, a short recording of this moment, or the map as a page."

    def __init__(self) -> None:
        """Start without a request."""
        self._job: tuple[ShareAction, Callable[[], Any]] | None = None
        self._count = 0

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether a recording is on show."""
        return not context.is_live

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Offer the link and the exports, and report the written files."""
        builder = AnswerBuilder()
        if context.is_live:
            builder.add_line(
                "Only a recording can be shared: press R, let it happen, press N, and open it under “Replay”."
            )
            return builder.build()
        self._link(builder, context, selection)
        where = str(context.library.folder)
        length_s = _BEFORE_S + _AFTER_S
        builder.add_line(_action_link(ShareAction.SAVE_EXCERPT), f": {length_s:.0f} s, with a test, in {where}")
        builder.add_line(_action_link(ShareAction.SAVE_MAP), f", in {where}")
        builder.add_line(_action_link(ShareAction.OPEN_IN_RERUN), ": all rows of the recording, in a window of its own")
        self._answer(builder, context)
        return builder.build()

    def handle_request(self, context: DebugContext, request: ShareRequest) -> None:
        """Start the export of a link. Raises OptionError."""
        if context.is_live:
            raise OptionError("Open a recording under “Replay” first.")
        self._count += 1  # A repeated request is a new export with another name.
        self._job = request.action, _computation(context, request.action)

    def _link(self, builder: AnswerBuilder, context: DebugContext, selection: Selection) -> None:
        seconds = max(0.0, context.moment.stamp - context.start_s)
        question = QuestionName.FIRST if selection == NOTHING_SELECTED else QuestionName.EDGE
        address = link(context.name, seconds, question, selection)
        builder.add_line(Address("Link to this moment", address), " · ", Copyable("copy it", address))
        builder.add_line(
            "It works in any page of this machine whose recordings folder holds this file; a new tab asks for the "
            "address that the terminal printed."
        )
        command = f"ltvn replay {quote(context.name)} --at {seconds:.1f}"
        builder.add_line("Elsewhere: send the file, and ", Code(command), " · ", Copyable("copy the command", command))

    def _answer(self, builder: AnswerBuilder, context: DebugContext) -> None:
        if self._job is None:
            return
        words, compute = self._job
        try:
            found = context.in_background(("share", self._count), compute)
        except LtvnError as error:
            builder.add_line(f"Could not {words}: {error}")
            return
        if found is None:
            builder.add_pending(words.capitalize())
        elif isinstance(found, str):
            builder.add_line(Address("Rerun is open here", found, in_new_tab=True), "; it closes with this app.")
        else:
            builder.add_line(
                "Written: ",
                joined((Download(each.title, each.path.name, each.address) for each in found), " and "),
                ". Click one to download it.",
            )


def _action_link(action: ShareAction) -> Inline:
    return request_link(str(action), ShareRequest(action))


def _computation(context: DebugContext, action: ShareAction) -> Callable[[], Any]:
    """Return the computation for the worker's thread, for the current moment."""
    library = context.library
    name = context.name
    stamp = context.moment.stamp
    rerun = context.rerun
    offer = context.offer_file
    plan = context.floor_plan
    match action:
        case ShareAction.SAVE_EXCERPT:
            return lambda: [*map(offer, save_excerpt(library, name, stamp - _BEFORE_S, stamp + _AFTER_S))]
        case ShareAction.SAVE_MAP:
            return lambda: [*map(offer, save_map(library, name, stamp, plan))]
        case ShareAction.OPEN_IN_RERUN:
            return lambda: rerun(library.path(name))
    assert_never(action)
