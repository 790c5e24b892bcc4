"""`ltvn app | replay`: the page in the browser."""

import logging
import shutil
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from ltvn_core.errors import RecordingError
from ltvn_core.verbs.verb import Verb
from ltvn_viz.app_settings import AppSettings
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions

if TYPE_CHECKING:
    from ltvn_core.data.importing.floor_plan_alignment import LaidFloorPlan

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class AppSummary:
    """Summary after the page was closed."""

    scene: str
    port: int


@dataclass(frozen=True, kw_only=True)
class AppVerb(AppSettings, FloorPlanOptions, Verb):
    """Open the page: drive, map, click a goal, watch. Without options: the demo apartment and its ready-made map."""

    def run(self) -> AppSummary:
        """Serve the page until interrupted; raises LtvnError."""
        import viser  # noqa: F401  (first, so that an error names the extra of the page)

        from ltvn_core.atomic_files import require_writable

        try:
            require_writable(self.recordings / "part")
        except RecordingError as error:
            _LOG.warning("Recordings can be replayed, but nothing can be recorded: %s", error)
        return self.serve(self.lay_floor_plan(self.map))

    def serve(
        self, laid: "LaidFloorPlan | None", *, replay: str | None = None, at_s: float = 0.0, ask: str = ""
    ) -> AppSummary:
        """Serve the page with a floor plan, on a recording of the folder or on the robot. Raises LtvnError."""
        from ltvn_core.verbs.option_types import announce_stream
        from ltvn_viz.app import AppOptions, run_app
        from ltvn_viz.session.options import DEMO_SCENE

        _LOG.info("Starting the app…")
        settings = {field.name: getattr(self, field.name) for field in fields(AppSettings)}
        settings["stream"] = announce_stream(self.stream)
        options = AppOptions(**settings, replay=replay, replay_at_s=at_s, replay_question=ask, floor_plan=laid)
        run_app(options, say=_LOG.info)
        return AppSummary(self.scene or self.robot or DEMO_SCENE, self.port)


@dataclass(frozen=True, kw_only=True)
class ReplayVerb(FloorPlanOptions, Verb):
    """Open the page on a recording, with a slider over its time."""

    recording: Positional[Path]
    """The .rrd file."""
    at: float = 0.0
    """Initial time, in seconds after the beginning of the recording."""
    ask: str = ""
    """Initial question of the debugger, by its word: edge (why is it so?), failures (what failed?), where, what-if,
    time, truth, or any other word in a link of the page."""
    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""

    def run(self) -> AppSummary:
        """Serve the page until interrupted; raises LtvnError."""
        import viser  # noqa: F401  (first, so that an error names the extra of the page)

        from ltvn_core.data.recording.info import read_info
        from ltvn_core.readable_text import readable

        recording = self._find()
        page = AppVerb(port=self.port, scene=read_info(recording).scene, recordings=recording.parent)
        laid = self.lay_floor_plan(recording)
        return page.serve(laid, replay=readable(recording.name), at_s=self.at, ask=self.ask)

    def _find(self) -> Path:
        """Return the recording; a demo file that is given by its bare name is copied into `recordings` first."""
        from ltvn_core.atomic_files import atomic_output
        from ltvn_core.data.recording.demo_files import demo_file

        if self.recording.exists():
            return self.recording
        shipped = demo_file(self.recording.name)
        if shipped is None or self.recording.parent not in (Path(), Path("recordings")):
            raise RecordingError(f"{self.recording} does not exist; give the path of a .rrd recording.")
        copy = Path("recordings") / shipped.name
        if not copy.exists():
            with atomic_output(copy) as part:
                shutil.copyfile(shipped, part)
            _LOG.info("Copied the demo recording to %s.", copy)
        return copy
