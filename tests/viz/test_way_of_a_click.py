"""The way of a click on a goal image: what docs/architecture.md lists is what runs, from the socket to the drawing."""

import re
import threading
from pathlib import Path
from types import FrameType

from ltvn_viz.wishes.commands import Action
from tests.browser.flat_app import serving, until_shown
from tests.repository import ROOT
from tests.viz.page_sockets import open_live_page
from tests.waiting import until

STATIONS = (
    *("Wish.value_of", "DriverSeat.try_sit", "Session.send", "Wish.refusal", "LiveMap.query", "Navigation._drain"),
    *("Navigation._think", "Planner.plan", "Timeline.append_event", "SnapshotBuilder.build", "Painter.publish"),
    "PlanView.show",
)
"""Where a click comes by; its way are the functions on the stack there, up to an earlier station."""
LISTED = re.compile(r"^    (ltvn_\S+\.(?:py|js))  +(\w.*)$", re.MULTILINE)
"""A file of the way with its functions."""


def test_the_documented_way_of_a_click_is_the_real_one(tmp_path: Path) -> None:
    found: dict[str, list[tuple[str, str]]] = {}
    clicked = threading.Event()

    def note(frame: FrameType | None, event: str, _: object) -> None:
        station = "" if frame is None else frame.f_code.co_qualname
        if not clicked.is_set() or event != "call" or station not in STATIONS or station in found:
            return
        stack = found[station] = []
        while frame is not None and (not stack or frame.f_code.co_qualname not in STATIONS):
            path = Path(frame.f_code.co_filename)
            if path.is_relative_to(ROOT) and path.relative_to(ROOT).parts[0] in ("ltvn_core", "ltvn_viz"):
                stack.insert(0, (path.relative_to(ROOT).as_posix(), frame.f_code.co_qualname.split(".<")[0]))
            frame = frame.f_back

    threading.setprofile(note)  # In all threads that begin from here on.
    try:
        with serving(tmp_path) as app, open_live_page(app.server) as page:
            until_shown(app, lambda now: bool(now.gallery))
            page.take_seat()
            until(lambda: app.harness.state.worker.pending == 0)
            clicked.set()
            page.ask(Action.SELECT, app.harness.far_node)
            until(lambda: found.keys() == set(STATIONS))
    finally:
        threading.setprofile(None)
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    listed = [(path, name) for path, names in LISTED.findall(text) for name in names.split(", ")]
    scripts = [(path, name) for path, name in listed if path.endswith(".js")]
    assert all(f"function {name}(" in (ROOT / path).read_text(encoding="utf-8") for path, name in scripts)
    ran = {each for stack in found.values() for each in stack}
    assert set(listed) - set(scripts) == ran
    assert f"{len(listed)} functions in {len({path for path, _ in listed})} files" in text
