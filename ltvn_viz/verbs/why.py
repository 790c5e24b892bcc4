"""`ltvn why`: any question of the Why tab about a recording or a map, answered in the terminal."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class WhyVerb(Verb):
    """Ask the debugger's questions about a recording or a map, in the terminal. Without a question, list all questions
    that can be answered."""

    job = "ltvn_viz.verbs.jobs.why:ask"

    file: Positional[Path]
    """The .rrd file; it is not changed."""
    ask: str = ""
    """The question, by its word: edge (why is it so?), failures (what failed?), what-if, time, where, compare, truth,
    or another word of the list. By default, edge for --edge and --node, and failures for --query."""
    at: float | None = None
    """Time in seconds after the beginning of the recording; by default the end of the query or of the recording."""
    edge: tuple[int, int] | None = None
    """Select the edge between two nodes: its source and its target."""
    node: int | None = None
    """Select a node."""
    query: int | None = None
    """Select a navigation task, by its number."""
    text: str = ""
    """Text for the question, as a person would type it, for instance --ask what-if --text "without 12->40"."""
    weights: Path | None = None
    """The weights with which the file was made, if not the shipped ones, for questions that compare images."""
