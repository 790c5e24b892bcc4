"""`ltvn plugins`: lists the plug-ins of all packages, whether they work, and tests one of them."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class PluginsVerb(Verb):
    """List the plug-ins of installed packages and whether they work; `ltvn plugins test NAME` tests one of them.

    A test opens the plug-in and checks its whole contract; a robot is not driven. The exit code is 1 if the contract is
    broken.
    """

    job = "ltvn_core.verbs.jobs.plugins:list_or_test"

    command: Positional[tuple[str, ...]] = ()
    """Without arguments, lists all plug-ins; `test NAME` tests one."""
    group: str = ""
    """Group of the plug-in, such as ltvn.predictors, if several groups have one of that name."""
    weights: Path | None = None
    """Weights or card of the predictor that is tested, as in `ltvn plugins test onnx --weights gnm.toml`."""
    drive: Path | None = None
    """A drive for the reader that is tested, as in `ltvn plugins test my-format --drive tour.bin`."""

    def exit_code(self, summary: Summary) -> int:
        """Return 1 if a plug-in breaks its contract."""
        return int(not getattr(summary, "passed", True))
