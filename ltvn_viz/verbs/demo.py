"""`ltvn demo`: the page's main job, in the page or without a browser."""

import logging
from dataclasses import dataclass, replace

from ltvn_core.errors import OptionError
from ltvn_core.verbs.demo import HeadlessDemoVerb
from ltvn_core.verbs.verb import Summary
from ltvn_viz.verbs.app import AppVerb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class DemoVerb(HeadlessDemoVerb):
    """Collect, build, navigate and record: the page's main job, or all of it without a browser (--headless)."""

    headless: bool = False
    """Run everything without a browser and print the result; by default the page opens."""
    robot: bool = False
    """Drive a simulated ROS 2 robot in the page; the robot, a router and a guard run in separate processes."""
    port: int = 8080
    """Port of the page on 127.0.0.1; 0 takes any free one."""

    def run(self) -> Summary:
        """Run the demo; raises OptionError, SceneError, RecordingError, MapError and WeightsError."""
        if self.robot:
            return self._drive_robot()
        if self.headless:
            return super().run()
        if self.story:
            raise OptionError("--story needs --headless. In the page, press “Watch it learn” under “World”.")
        return replace(self._page, scene=self.scene, body=self.body).run()

    @property
    def _page(self) -> AppVerb:
        """The page with the settings that all robots share."""
        return AppVerb(
            port=self.port,
            seed=self.seed,
            predictor=self.predictor,
            weights=self.weights,
            stream=self.stream,
        )

    def _drive_robot(self) -> Summary:
        """Start a ROS 2 robot and the page that drives it; in the demo apartment, use its ready-made map."""
        from ltvn_core.data.recording.demo_files import DEMO_MAP, demo_file
        from ltvn_viz.session.options import DEMO_SCENE
        from ltvn_viz.verbs.robot_processes import robot_processes

        if self.headless or self.story:
            raise OptionError("--robot needs the page; omit --headless and --story.")
        _LOG.info("Starting a router, the simulated robot and its guard…")
        with robot_processes(self.scene, "--seed", str(self.seed), "--body", self.body) as robot:
            _LOG.info("For other programs of ROS 2 the robot is at %s.", robot.address)
            known = demo_file(DEMO_MAP) if self.scene == DEMO_SCENE else None
            return replace(self._page, robot=robot.place, map=known).run()
