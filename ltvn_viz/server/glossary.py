"""The words and symbols of the page, each explained in a sentence or two, shown on hover and as a list.

Owns the explanations for a person who sees the page. The glossary of code and paper is `docs/glossary.md`.
"""

from html import escape
from typing import NamedTuple


class Term(NamedTuple):
    """A word or symbol."""

    symbol: str
    """Symbol of the word in the page; empty if there is none."""
    name: str
    text: str


TERMS = (
    Term(
        "p",
        "existence",
        "Probability that the robot can drive this edge at all, from 0 to 1. Each attempt changes it.",
    ),
    Term("p open", "presence", "Probability that the edge is open now: a closed door may be open again later."),
    Term(
        "mu",
        "length (mu)",
        "Length of the edge, in the units of d; the planner adds the lengths up. ± is its standard deviation.",
    ),
    Term(
        "d",
        "distance",
        "Estimated distance between two images, from position and rotation together: 0 is the same view, 1 is about a "
        "metre.",
    ),
    Term(
        "r", "reachability", "Probability, from the network, that one image can be reached from another, from 0 to 1."
    ),
    Term("R_p", "pruning threshold", "An edge that fails and whose p falls below this is removed."),
    Term("R_c", "threshold of r", "To join two images by an edge, r must be above this."),
    Term("D_c", "threshold of d", "To join two images by an edge, d must be below this."),
    Term("D_l", "localisation threshold", "The robot is localised at a node only if d is below this."),
    Term(
        "margin",
        "margin",
        "How much better the best node fits than the second best: 0 means equally well, above 0.3 is clear.",
    ),
    Term("doubt", "doubt", "Part of the cost of an edge in a plan that comes from p, -ln p: 0 for a sure edge."),
    Term("", "node", "An image that stands for a place."),
    Term("", "edge", "A connection from one node to another that the robot believes it can drive."),
    Term("", "query", "One task: drive to a goal. A bar in the timeline."),
    Term("", "attempt", "Driving one edge, or several to a subgoal farther ahead, within a query."),
    Term("", "pruned", "An edge that was taken out of the map because it failed."),
    Term("", "collision", "The bumper touched something. Seeing that an edge is blocked is not a collision."),
    Term("", "piece", "Nodes with paths in both directions between all of them. A good map is in one piece."),
    Term("", "perceptual alias", "Another place that looks the same."),
)
_BY_SYMBOL = {term.symbol: term for term in TERMS if term.symbol} | {term.name: term for term in TERMS}


def explained(word: str, words: str = "") -> str:
    """Return a word, or `words` in its place, with an explanation on hover; plain text if the glossary lacks it."""
    term = _BY_SYMBOL.get(word)
    shown = escape(words or word)
    return shown if term is None else f'<abbr class="lt-term" title="{escape(term.text)}">{shown}</abbr>'
