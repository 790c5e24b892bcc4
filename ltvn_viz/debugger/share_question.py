"""Share: a link to what is on show, the moment as a small recording with a test, the map as page and figure, Rerun."""

from collections.abc import Callable
from html import escape
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

from ltvn_core.errors import LtvnError, OptionError
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.exports import save_excerpt, save_map
from ltvn_viz.debugger.question import AnswerBuilder
from ltvn_viz.session.commands import SubmitText
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.share_links import link

SAVE_EXCERPT, SAVE_MAP, OPEN_IN_RERUN = "save this moment", "save the map as a page and a figure", "open in Rerun"
_BEFORE_S, _AFTER_S = 8.0, 2.0


class _ShareRequest(NamedTuple):
    """Something slow that a person asked for."""

    words: str
    question: tuple[Any, ...]
    compute: Callable[[], Any]


class ShareQuestion:
    """Hands out what is on show."""

    about = "Show somebody what you see: a link, a small recording of this moment, the map as a page."

    def __init__(self) -> None:
        """Nothing was asked for yet."""
        self._request: _ShareRequest | None = None
        self._count = 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Offer the link and the files, and say what was written."""
        builder = AnswerBuilder()
        if context.is_live:
            builder.add_text(
                "Only a recording can be shown to somebody else: press R, let it happen, press N, and open it under "
                "“Replay”."
            )
            return builder.build()
        self._link(builder, context, selection)
        where = escape(str(context.library.folder))
        builder.add_html(
            f"<div>{builder.link(SAVE_EXCERPT, SubmitText(SAVE_EXCERPT))}: "
            f"{_BEFORE_S + _AFTER_S:.0f} s, with a test, in {where}</div>"
        )
        builder.add_html(f"<div>{builder.link(SAVE_MAP, SubmitText(SAVE_MAP))}, in {where}</div>")
        builder.add_html(
            f"<div>{builder.link(OPEN_IN_RERUN, SubmitText(OPEN_IN_RERUN))}: "
            "all rows of the recording, in a window of its own</div>"
        )
        self._answer(builder, context)
        return builder.build()

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Begin what a link asks for. Raises OptionError."""
        if context.is_live:
            raise OptionError("Open a recording under “Replay” first.")
        library, name, stamp, rerun = context.library, context.name, context.moment.stamp, context.rerun
        begin, end = stamp - _BEFORE_S, stamp + _AFTER_S
        requests: dict[str, Callable[[], Any]] = {
            SAVE_EXCERPT: lambda: save_excerpt(library, name, begin, end),
            SAVE_MAP: lambda: save_map(library, name, stamp),
            OPEN_IN_RERUN: lambda: rerun(library.path(name)),
        }
        if text not in requests:
            raise OptionError(f"Click one of the links: {', '.join(requests)}.")
        self._count += 1  # Asked twice is done twice, under another name.
        self._request = _ShareRequest(text, ("share", self._count, text), requests[text])

    def _link(self, builder: AnswerBuilder, context: DebugContext, selection: Selection) -> None:
        seconds = max(0.0, context.moment.stamp - context.start_s)
        question = QuestionName.NONE if selection == NOTHING_SELECTED else QuestionName.EDGE
        address = link(context.name, seconds, question, selection, context.viewpoint)
        builder.add_html(
            f'<div><a href="{escape(address)}" class="lt-link">Link to this moment</a>: right-click it to copy. It '
            "works in any page of this machine whose recordings folder holds this file.</div>"
        )
        command = f"ltvn replay {quote(context.name)} --at {seconds:.1f}"
        builder.add_html(f"<div>Elsewhere: send the file, and <code>{escape(command)}</code></div>")

    def _answer(self, builder: AnswerBuilder, context: DebugContext) -> None:
        if self._request is None:
            return
        try:
            found = context.in_background(self._request.question, self._request.compute)
        except LtvnError as error:
            builder.add_text(f"Could not {self._request.words}: {error}")
            return
        if found is None:
            builder.add_pending(self._request.words.capitalize())
        elif isinstance(found, str):
            builder.add_html(
                f'<div><a href="{escape(found)}" target="_blank" rel="noreferrer" class="lt-link">Rerun is open here'
                "</a>; it closes with this app.</div>"
            )
        else:
            builder.add_text(f"Written: {' and '.join(_size(path) for path in found)}.")


def _size(path: Path) -> str:
    return f"{path.name} ({path.stat().st_size / 1000:,.0f} kB)"
