"""Share: a link to what is on show, the moment as a small recording with a test, the map as page and figure, Rerun."""

from collections.abc import Callable
from html import escape
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

from ltvn_core.errors import LtvnError, OptionError
from ltvn_viz.commands import Tell
from ltvn_viz.links import link
from ltvn_viz.why.case import Case
from ltvn_viz.why.keepsakes import save_map, save_moment
from ltvn_viz.why.tool import NOWHERE, Page, Selection, ToolName, ToolView

MOMENT, MAP, RERUN = "save this moment", "save the map as a page and a figure", "open in Rerun"
_BEFORE_S, _AFTER_S = 8.0, 2.0


class _Wish(NamedTuple):
    """Something slow that a person asked for."""

    words: str
    question: tuple[Any, ...]
    compute: Callable[[], Any]


class ShareTool:
    """Hands out what is on show."""

    about = "Show somebody what you see: a link, a small recording of this moment, the map as a page."

    def __init__(self) -> None:
        """Nothing was asked for yet."""
        self._wish: _Wish | None = None
        self._count = 0

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Offer the link and the files, and say what was written."""
        page = Page()
        if case.is_live:
            page.line(
                "Only a recording can be shown to somebody else: press R, let it happen, press N, and open it under "
                "“Replay”."
            )
            return page.view()
        self._link(page, case, selection)
        where = escape(str(case.library.folder))
        page.html(
            f"<div>{page.link(MOMENT, Tell(MOMENT))}: {_BEFORE_S + _AFTER_S:.0f} s, with a test, in {where}</div>"
        )
        page.html(f"<div>{page.link(MAP, Tell(MAP))}, in {where}</div>")
        page.html(f"<div>{page.link(RERUN, Tell(RERUN))}: all rows of the recording, in a window of its own</div>")
        self._answer(page, case)
        return page.view()

    def told(self, case: Case, text: str) -> None:
        """Begin what a link asks for. Raises OptionError."""
        if case.is_live:
            raise OptionError("Open a recording under “Replay” first.")
        library, name, stamp, rerun = case.library, case.name, case.moment.stamp, case.rerun
        begin, end = stamp - _BEFORE_S, stamp + _AFTER_S
        wishes: dict[str, Callable[[], Any]] = {
            MOMENT: lambda: save_moment(library, name, begin, end),
            MAP: lambda: save_map(library, name, stamp),
            RERUN: lambda: rerun(library.path(name)),
        }
        if text not in wishes:
            raise OptionError(f"Click one of the links: {', '.join(wishes)}.")
        self._count += 1  # Asked twice is done twice, under another name.
        self._wish = _Wish(text, ("share", self._count, text), wishes[text])

    def _link(self, page: Page, case: Case, selection: Selection) -> None:
        seconds = max(0.0, case.moment.stamp - case.start_s)
        tool = ToolName.NONE if selection == NOWHERE else ToolName.EDGE
        address = link(case.name, seconds, tool, selection, case.view)
        page.html(
            f'<div><a href="{escape(address)}" class="lt-link">Link to this moment</a>: right-click it to copy. It '
            "works in any page of this machine whose recordings folder holds this file.</div>"
        )
        command = f"ltvn replay {quote(case.name)} --at {seconds:.1f}"
        page.html(f"<div>Elsewhere: send the file, and <code>{escape(command)}</code></div>")

    def _answer(self, page: Page, case: Case) -> None:
        if self._wish is None:
            return
        try:
            found = case.later(self._wish.question, self._wish.compute)
        except LtvnError as error:
            page.line(f"Could not {self._wish.words}: {error}")
            return
        if found is None:
            page.line(f"{self._wish.words.capitalize()} …")
        elif isinstance(found, str):
            page.html(
                f'<div><a href="{escape(found)}" target="_blank" rel="noreferrer" class="lt-link">Rerun is open here'
                "</a>; it closes with this app.</div>"
            )
        else:
            page.line(f"Written: {' and '.join(_size(path) for path in found)}.")


def _size(path: Path) -> str:
    return f"{path.name} ({path.stat().st_size / 1000:,.0f} kB)"
