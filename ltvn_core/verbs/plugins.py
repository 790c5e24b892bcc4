"""`ltvn plugins`: what packages add to the toolkit, whether it works, and a test of it."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class PluginsVerb(Verb):
    """List what installed packages add to the toolkit, and whether it works; `ltvn plugins test NAME` tries one of it.

    A test opens the plug-in and looks at every point of its contract; a robot is looked at and not driven. It ends with
    exit code 1 where a point is broken.
    """

    job = "ltvn_core.verbs.jobs.plugins:list_or_test"

    command: Positional[tuple[str, ...]] = ()
    """Without arguments, lists all plug-ins; `test NAME` tests one."""
    group: str = ""
    """Where several groups have the name: the one meant, as in ltvn.predictors."""
    weights: Path | None = None
    """Weights or card of the predictor that is tested, as in `ltvn plugins test onnx --weights gnm.toml`."""

    def exit_code(self, summary: Summary) -> int:
        """Fail where a plug-in breaks its contract."""
        return int(not getattr(summary, "passed", True))
