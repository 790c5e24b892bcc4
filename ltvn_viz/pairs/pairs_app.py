"""The composition root of the pair viewer: shards, network, guarded door, panel and scene, and the one loop.

Callbacks of the page only enqueue orders; the loop carries them out one after the other.
"""

import queue
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ltvn_core import palette
from ltvn_core.errors import LtvnError
from ltvn_core.network.predictor import load_predictor
from ltvn_viz.pairs.pair_browser import PairBrowser, PairCommand, scenes_in
from ltvn_viz.pairs.pair_panel import PairPanel
from ltvn_viz.pairs.pair_scene import PairScene
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.shutdown_signals import stop_on_signals

PANEL_PX = 520
TITLE = "Labelled pairs"


@dataclass(frozen=True)
class PairsOptions:
    """What a person may choose."""

    folder: Path
    port: int = 8080
    weights: Path | None = None
    """None stands for the shipped ones."""


class PairsApp:
    """A page that is served; `run` gives it life."""

    def __init__(self, server: GuardedServer, browser: PairBrowser) -> None:
        """Furnish the page and show the first pair."""
        self.server = server
        self._browser = browser
        self._commands: queue.SimpleQueue[PairCommand | None] = queue.SimpleQueue()
        gui = server.gui
        accent = (palette.ACCENT.red, palette.ACCENT.green, palette.ACCENT.blue)
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=accent)
        gui.set_panel_label(TITLE)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        self._panel = PairPanel(gui, browser.scenes, self._commands.put)
        self._space = PairScene(server.viser)
        self._show()

    def run(self) -> None:
        """Obey until stopped."""
        while (command := self._commands.get()) is not None:
            if self._browser.is_slow(command):
                self._panel.show_busy("Asking the network about every pair of this scene…")
            try:
                self._browser.handle(command)
            except LtvnError as error:
                self._panel.show_error(str(error))
            else:
                self._show()

    def stop(self) -> None:
        """End `run`. May be called from any thread and from a signal handler."""
        self._commands.put(None)

    def _show(self) -> None:
        shown_pair = self._browser.shown_pair()
        with self.server.viser.atomic():
            self._panel.show(shown_pair)
            self._space.show(shown_pair)


@contextmanager
def open_pairs_app(options: PairsOptions) -> Iterator[PairsApp]:
    """Serve the viewer; raises DatasetError, WeightsError and ServerError before anything is served."""
    browser = PairBrowser(scenes_in(options.folder), load_predictor(options.weights))
    with GuardedServer(port=options.port, drives=False) as server:
        yield PairsApp(server, browser)


def run_pairs_app(options: PairsOptions, say: Callable[[str], None]) -> None:
    """Serve the viewer until interrupted; `say` gets the lines a person needs to open it. Raises LtvnError."""
    with open_pairs_app(options) as app, stop_on_signals(app.stop):
        port = app.server.port
        say(f"Open {app.server.url}")
        say(f"From another machine, first: ssh -L {port}:127.0.0.1:{port} THIS_MACHINE")
        app.run()
