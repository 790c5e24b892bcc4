"""Why did it do that? Pure functions over what happened: folds over the events of one run, and questions to its map.

Usable in a notebook with numpy and a recording alone; a network, if one is needed, is passed in as a `Predictor`.
The page only shows these results. The names below are the entry points.
"""

from ltvn_core.analysis.edge_explanation import explain_edge_belief, explain_missing_edge, explain_pruned_edge
from ltvn_core.analysis.edge_history import edge_history
from ltvn_core.analysis.failure_triage import failed_queries, group_by_failure_mode, group_by_place
from ltvn_core.analysis.lifelong_success import lifelong_success
from ltvn_core.analysis.localisation_confidence import find_perceptual_aliases
from ltvn_core.analysis.map_comparison import compare_maps, map_metrics
from ltvn_core.analysis.timeline import Timeline

__all__ = [
    "Timeline",
    "compare_maps",
    "edge_history",
    "explain_edge_belief",
    "explain_missing_edge",
    "explain_pruned_edge",
    "failed_queries",
    "find_perceptual_aliases",
    "group_by_failure_mode",
    "group_by_place",
    "lifelong_success",
    "map_metrics",
]
