"""`ltvn app | replay`: the page in the browser."""

import logging
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.atomic_files import atomic_output
from ltvn_core.errors import RecordingError
from ltvn_core.systems.maintenance_names import MaintenanceName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.stream_option import announce_stream
from ltvn_core.verbs.system_option import SystemName
from ltvn_core.verbs.verb import Summary, Verb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class AppSummary:
    """The page is closed again."""

    scene: str
    port: int


@dataclass(frozen=True, kw_only=True)
class AppVerb(Verb):
    """Open the page: drive, map, click a goal, watch. Without options: the demo apartment and its ready-made map."""

    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    scene: str = ""
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder; by default the
    demo apartment. With --robot: what recordings call the place, by default the robot's name."""
    robot: str | None = None
    """Drive a robot of your own instead of the simulated one: an installed robot's name, path/to/file.py:factory, or
    PROFILE@ADDRESS (ROS 2), as in turtlebot4@tcp/192.168.0.7:7447. A recorded drive, such as drive.mcap, is played."""
    map: Path | None = None
    """Map to begin with; by default the ready-made one in the demo apartment, else an empty one."""
    recordings: Path = Path("recordings")
    """Folder in which recordings are written and found."""
    method: SystemName = DEFAULT_SYSTEM
    """Ours, or a rival: it builds maps and drives by them. A map that is opened brings its own."""
    predictor: PredictorName = AUTO
    """What compares images, by name; auto takes the one that made the map, else the network for the simulated robot and
    geometric for a robot of your own with another camera."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
    preset: Literal["robust", "paper"] = "robust"
    """The method's settings: robust is ours, paper is the literal method."""
    maintenance: MaintenanceName | None = None
    """What driving teaches the map; by default what its system does. static: nothing; paper, robust: beliefs and
    pruning as in that preset; brm: BRM's posterior, which prunes nothing; persistent: also what is open at which
    time."""
    world: str | None = None
    """Let the scene change by itself, from nine o'clock on: static, doors, daily, telegraph, moving, light, people,
    all, several of them (doors+moving), or a JSON file with a script."""
    seed: int = 0
    """Draws the robot's start, the odometry noise and what changes in the world."""
    body: BodyOption = "auto"
    stream: int | None = None
    """Port on 127.0.0.1 at which a Rerun viewer can watch while the recording is written: `ltvn view` the address."""

    def run(self) -> Summary:
        """Serve the page until interrupted; raises LtvnError."""
        return _serve(self, replay=None)


@dataclass(frozen=True, kw_only=True)
class ReplayVerb(Verb):
    """Open the page on a recording, with a slider over its time."""

    recording: Positional[Path]
    """The .rrd file."""
    at: float = 0.0
    """Seconds after its beginning at which to show it first."""
    ask: str = ""
    """A question for the debugger to open with, by its word: blame (why is it so?), failures (what failed?), where,
    edge, what-if, time, presence, truth, or any other that a link of the page names."""
    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""

    def run(self) -> Summary:
        """Serve the page until interrupted; raises LtvnError."""
        from ltvn_core.recording.info import read_info

        recording = self._find()
        scene = read_info(recording).scene
        app = AppVerb(port=self.port, scene=scene, recordings=recording.parent)
        return _serve(app, replay=recording.name, at_s=self.at, ask=self.ask)

    def _find(self) -> Path:
        """Return the recording; a demo file that is meant by its name alone is copied into `recordings` first."""
        from ltvn_core.recording.demo_files import demo_file

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


def _serve(options: AppVerb, replay: str | None, at_s: float = 0.0, ask: str = "") -> AppSummary:
    _LOG.info("Starting the app…")
    import viser  # noqa: F401  (first, so that an error names the extra of the page)

    from ltvn_viz.app import AppOptions, run_app
    from ltvn_viz.session.options import DEMO_SCENE

    run_app(
        AppOptions(
            port=options.port,
            scene=options.scene,
            robot=options.robot,
            map=options.map,
            recordings=options.recordings,
            system=options.method,
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
        ),
        say=_LOG.info,
    )
    return AppSummary(options.scene or options.robot or DEMO_SCENE, options.port)
