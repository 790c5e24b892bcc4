"""`ltvn app | replay`: the page in the browser."""

import logging
import shutil
from dataclasses import dataclass
from pathlib import Path

import viser  # noqa: F401  (first, so that an error names the extra of the page)

from ltvn_core.atomic_files import atomic_output, require_writable
from ltvn_core.data.importing.floor_plan_alignment import LaidFloorPlan
from ltvn_core.data.recording.demo_files import demo_file
from ltvn_core.data.recording.info import read_info
from ltvn_core.errors import RecordingError
from ltvn_core.readable_text import readable
from ltvn_core.verbs.jobs.stream import announce_stream
from ltvn_core.verbs.verb import Summary
from ltvn_viz.app import AppOptions, run_app
from ltvn_viz.session.options import DEMO_SCENE
from ltvn_viz.verbs.app import AppVerb, ReplayVerb
from ltvn_viz.verbs.jobs.floor_plan import lay_floor_plan

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class AppSummary:
    """Summary after the page was closed."""

    scene: str
    port: int


def open_page(options: AppVerb) -> Summary:
    """Serve the page until interrupted; raises LtvnError."""
    try:
        require_writable(options.recordings / "part")
    except RecordingError as error:
        _LOG.warning("Recordings can be replayed, but nothing can be recorded: %s", error)
    return _serve(options, lay_floor_plan(options, options.map), replay=None)


def open_replay(options: ReplayVerb) -> Summary:
    """Serve the page until interrupted; raises LtvnError."""
    recording = _find(options)
    scene = read_info(recording).scene
    app = AppVerb(port=options.port, scene=scene, recordings=recording.parent)
    laid = lay_floor_plan(options, recording)
    return _serve(app, laid, replay=readable(recording.name), at_s=options.at, ask=options.ask)


def _find(options: ReplayVerb) -> Path:
    """Return the recording; a demo file that is given by its bare name is copied into `recordings` first."""
    if options.recording.exists():
        return options.recording
    shipped = demo_file(options.recording.name)
    if shipped is None or options.recording.parent not in (Path(), Path("recordings")):
        raise RecordingError(f"{options.recording} does not exist; give the path of a .rrd recording.")
    copy = Path("recordings") / shipped.name
    if not copy.exists():
        with atomic_output(copy) as part:
            shutil.copyfile(shipped, part)
        _LOG.info("Copied the demo recording to %s.", copy)
    return copy


def _serve(
    options: AppVerb, laid: LaidFloorPlan | None, replay: str | None, at_s: float = 0.0, ask: str = ""
) -> AppSummary:
    _LOG.info("Starting the app…")
    run_app(
        AppOptions(
            port=options.port,
            scene=options.scene,
            robot=options.robot,
            map=options.map,
            recordings=options.recordings,
            system=options.system,
            predictor=options.predictor,
            weights=options.weights,
            preset=options.preset,
            maintenance=options.maintenance,
            world=options.world,
            seed=options.seed,
            body=options.body,
            stream=announce_stream(options.stream),
            replay=replay,
            replay_at_s=at_s,
            replay_question=ask,
            floor_plan=laid,
        ),
        say=_LOG.info,
    )
    return AppSummary(options.scene or options.robot or DEMO_SCENE, options.port)
