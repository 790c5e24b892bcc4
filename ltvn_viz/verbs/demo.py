"""`ltvn demo`: the page's main job, in the page or without a browser."""

import logging
from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.verbs.demo import HeadlessDemoVerb
from ltvn_core.verbs.verb import Summary
from ltvn_viz.verbs.app import AppVerb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class DemoVerb(HeadlessDemoVerb):
    """Collect, build, navigate and record: the page's main job, or all of it without a browser (--headless)."""

    headless: bool = False
    """Do it all here and print the result; without this the page opens."""
    robot: bool = False
    """Let the page drive a robot of ROS 2: the simulated one, behind a router and a guard, each a process."""
    port: int = 8080
    """Port of the page on 127.0.0.1; 0 takes any free one."""

    def run(self) -> Summary:
        """Do the job; raises OptionError, SceneError, RecordingError, MapError and WeightsError."""
        if self.robot:
            return self._drive_robot()
        if self.headless:
            return super().run()
        if self.story:
            raise OptionError("--story needs --headless. In the page, press “Watch it learn” under “World”.")
        page = AppVerb(
            port=self.port,
            scene=self.scene,
            seed=self.seed,
            predictor=self.predictor,
            weights=self.weights,
            body=self.body,
            stream=self.stream,
        )
        return page.run()

    def _drive_robot(self) -> Summary:
        """Start a robot of ROS 2 and the page that drives it; in the demo apartment with its ready-made map."""
        from ltvn_core.recording.demo_files import DEMO_MAP, demo_file
        from ltvn_viz.session.options import DEMO_SCENE
        from ltvn_viz.verbs.robot_processes import robot_processes

        if self.headless or self.story:
            raise OptionError("--robot is for the page; leave --headless and --story out.")
        _LOG.info("Starting a router, the simulated robot and its guard…")
        with robot_processes(self.scene, "--seed", str(self.seed), "--body", self.body) as robot:
            _LOG.info("For other programs of ROS 2 the robot is at %s.", robot.address)
            page = AppVerb(
                port=self.port,
                robot=robot.place,
                map=demo_file(DEMO_MAP) if self.scene == DEMO_SCENE else None,
                seed=self.seed,
                predictor=self.predictor,
                weights=self.weights,
                stream=self.stream,
            )
            return page.run()
