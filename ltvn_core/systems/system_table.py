"""The navigation systems of this package, one row each: what it keeps, weighs, localises by and learns from.

The rules are in the modules beside this one, with their sources. SPTM and HTM drive by temporal closeness, ViNG, SGM
and SoRB by temporal distance; BRM and PlaceNav exchange one part of our own system.
"""

from dataclasses import replace

from ltvn_core.config import Method
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.navigation_system import NavigationSystem, NoMaintenance
from ltvn_core.network.architecture import ContrastiveArchitecture, EnsembleArchitecture
from ltvn_core.network.shipped_weights import shipped_weights
from ltvn_core.network.training_data.temporal_rules import TemporalClosenessRule, TemporalDistanceRule
from ltvn_core.systems import meng, temporal_closeness, temporal_distance
from ltvn_core.systems.brm import BayesianEdges
from ltvn_core.systems.entry import SystemEntry, TemporalLearning
from ltvn_core.systems.placenav import BayesFilter
from ltvn_core.systems.rival import hop_cost, localise_at_most_reachable, rival, surprise_cost

LTVN = SystemEntry(name="ltvn", label="LTVN", factory=ltvn_system, preset_in_label=True)

SPTM = rival(
    "sptm",
    "SPTM",
    keeps=temporal_closeness.keep_shortcuts,
    weighs=hop_cost,
    localises=temporal_closeness.localise_near_path,
    subgoal=temporal_closeness.choose_farthest_close_node,
    weights=shipped_weights("sptm"),
    learning=TemporalLearning(TemporalClosenessRule()),
)
VING = rival(
    "ving",
    "ViNG",
    keeps=temporal_distance.keep_near_images,
    weighs=temporal_distance.temporal_cost,
    localises=temporal_distance.NearestInTime(temporal_distance.EDGE_STEPS),
    scaled=temporal_distance.with_step_thresholds,
    weights=shipped_weights("ving"),
    learning=TemporalLearning(TemporalDistanceRule(), even_distances=False),
)
MENG = rival(
    "meng",
    "Meng et al.",
    keeps=meng.keep_anchors,
    weighs=surprise_cost,
    localises=meng.localise_on_anchors,
)
SGM = rival(
    "sgm",
    "SGM",
    keeps=temporal_distance.keep_consistent_images,
    weighs=hop_cost,
    localises=temporal_distance.NearestInTime(),  # Localisation has no limit of distance.
    maintenance=temporal_distance.DeleteOnFailure(),
    scaled=temporal_distance.with_step_thresholds,
    weights=VING.weights,
    learning=VING.learning,
)
SORB = rival(
    "sorb",
    "SoRB",
    keeps=temporal_distance.keep_buffer,
    weighs=temporal_distance.temporal_cost,
    localises=temporal_distance.NearestInTime(temporal_distance.MAX_STEPS),
    subgoal=temporal_distance.choose_goal_if_nearer,
    scaled=temporal_distance.with_step_thresholds,
    weights=shipped_weights("sorb"),
    learning=TemporalLearning(TemporalDistanceRule(), even_distances=False, added=EnsembleArchitecture()),
)
HTM = rival(
    "htm",
    "HTM",
    keeps=temporal_closeness.keep_cheapest_edges,
    weighs=temporal_closeness.inverse_share,
    localises=localise_at_most_reachable,
    weights=shipped_weights("htm"),
    learning=TemporalLearning(TemporalClosenessRule(), even_distances=False, added=ContrastiveArchitecture()),
)


def _brm(method: Method) -> NavigationSystem:
    maintenance = BayesianEdges() if method.maintain else NoMaintenance()
    return replace(ltvn_system(method), name="brm", edge_weight=surprise_cost, maintenance=maintenance, online=None)


def _placenav(method: Method) -> NavigationSystem:
    return replace(ltvn_system(method), name="placenav", localise=BayesFilter(), follows_places=False)


BRM = SystemEntry(name="brm", label="BRM", factory=_brm)
PLACENAV = SystemEntry(name="placenav", label="PlaceNav", factory=_placenav, preset_in_label=True)
