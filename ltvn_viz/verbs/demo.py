"""`ltvn demo`: the page's main job, in the page or without a browser."""

from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.verbs.demo import HeadlessDemoVerb
from ltvn_core.verbs.verb import Summary
from ltvn_viz.verbs.app import AppVerb


@dataclass(frozen=True, kw_only=True)
class DemoVerb(HeadlessDemoVerb):
    """Collect, build, navigate and record: the page's main job, or all of it without a browser (--headless)."""

    headless: bool = False
    """Do it all here and print the result; without this the page opens."""

    def run(self) -> Summary:
        """Do the job; raises OptionError, SceneError, RecordingError, MapError and WeightsError."""
        if self.headless:
            return super().run()
        if self.story:
            raise OptionError("--story needs --headless. In the page, press “Watch it learn” under “World”.")
        page = AppVerb(
            scene=self.scene, seed=self.seed, predictor=self.predictor, weights=self.weights, stream=self.stream
        )
        return page.run()
