"""`ltvn demo`: the page's main job, in the page or without a browser."""

from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.verbs.demo import HeadlessDemoVerb
from ltvn_core.verbs.verb import Summary, do_job
from ltvn_viz.verbs.app import AppVerb


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
            return do_job("ltvn_viz.verbs.jobs.robot_demo:drive_robot", self)
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
