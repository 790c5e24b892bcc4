"""Analysis of a run: explains, from its events and its map, why the robot did what it did.

All functions are pure. They need numpy and a recording alone, for instance in a notebook; a network, if one is needed,
is passed in as a `Predictor`. The page only shows these results. The names below are the entry points.
"""

from ltvn_core.analysis.answer_text import answer_text
from ltvn_core.analysis.edge_explanation import explain_edge
from ltvn_core.analysis.edge_story import edge_story
from ltvn_core.analysis.failure_triage import failed_queries, group_by_failure_mode, group_by_place
from ltvn_core.analysis.lifelong_success import lifelong_success
from ltvn_core.analysis.localisation_confidence import find_perceptual_aliases
from ltvn_core.analysis.map_comparison import compare_maps, map_metrics
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.navigation.event_table import describe_event

__all__ = [
    "Timeline",
    "answer_text",
    "compare_maps",
    "describe_event",
    "edge_story",
    "explain_edge",
    "failed_queries",
    "find_perceptual_aliases",
    "group_by_failure_mode",
    "group_by_place",
    "lifelong_success",
    "map_metrics",
]
