"""`ltvn why`: any question of the Why tab about a recording or a map, answered in the terminal."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class WhyVerb(Verb):
    """Ask the debugger's questions about a recording or a map, in the terminal. Without a question, list those that it
    can answer.
    """

    job = "ltvn_viz.verbs.jobs.why:ask"

    file: Positional[Path]
    """The .rrd file; it is left as it is."""
    ask: str = ""
    """The question by its word: edge (why is it so?), failures (what failed?), what-if, time, where, compare, truth,
    or another of the list. If not given, --edge and --node ask edge, and --query failures."""
    at: float | None = None
    """Seconds after the beginning of the recording; the end if not given, or the end of the query."""
    edge: tuple[int, int] | None = None
    """Point at the edge between two nodes, from and to."""
    node: int | None = None
    """Point at a node."""
    query: int | None = None
    """Point at a navigation task, by its number."""
    text: str = ""
    """Text that a person would type into the question, for instance --ask what-if --text "without 12->40"."""
