"""Every threshold of the method, in one frozen dataclass, with two presets.

`PAPER` is the literal method, without any of our departures. `ROBUST`, the default, switches on the departures that are
needed according to measurements; each is one named field. The authors published no values, so every number is ours. In
a docstring, "paper" means that the quantity is theirs, "ours" that it is a departure or fills a gap in the paper.

Distances d are Eq. 2, which mixes metres with sqrt(2) per radian. Contains no behaviour.
"""

from dataclasses import dataclass, field

from ltvn_core.errors import OptionError
from ltvn_core.terminal_text import which_name


@dataclass(frozen=True, slots=True)
class MatchingConfig:
    """Comparison of two images."""

    reverse_within: float = 1.5
    """Greatest predicted d of a pair that is also predicted in the other direction; must exceed D_c and D_l (ours).

    The more reachable result is kept, with an inverted waypoint if needed: our reading of the paper's "only targets in
    front are positive, the way back is driven in reverse". With 0, pairs are predicted in one direction."""
    temporal_support: bool = True
    """Limit r to the median over the frames before and after both images (ours)."""
    mend_slips: bool = True
    """Correct odometry if two consecutive depth images show that the wheels slipped (ours)."""
    closure_reach: int = 10
    """Number of images around both ends that are compared to confirm an edge between two passes; 0 = off (ours)."""

    @property
    def both_directions(self) -> bool:
        """Whether near pairs are predicted in both directions, so that an edge also leads back."""
        return self.reverse_within > 0


@dataclass(frozen=True, slots=True)
class BuildingConfig:
    """Algorithm 1: from a trajectory to a map."""

    merge_distance: float = 0.55
    """D_m: an image nearer than this to a node is merged (paper)."""
    connect_distance: float = 1.0
    """D_c: two images nearer than this are joined by an edge (paper)."""
    connect_reachability: float = 0.8
    """R_c: least r for an edge (ours; the paper does not specify it)."""
    bridges: bool = True
    """Connect images left over after Algorithm 1 to less reachable nodes, else to merged images, which become nodes;
    connect the rest to the next image of the drive by odometry, and goals over several images (ours)."""
    odometry_drift: float = 0.04
    """Drift of odometry in metres per metre driven; an edge that contradicts odometry by more is rejected; 0 = off
    (ours)."""
    close_loops: bool = True
    """Correct the drive's odometry by loop closures before the map is built (ours)."""
    floor_edges: bool = True
    """Add edges over free floor between nodes that no image joins, if they make a path much shorter (ours)."""
    keep_merged: bool = True
    """Keep merged images in the reserve T', which Algorithm 1 would otherwise leave nearly empty (ours)."""
    largest_piece: bool = True
    """Build another piece of the map while the left-over images could form a larger one; keep the largest (ours)."""


@dataclass(frozen=True, slots=True)
class LocalisingConfig:
    """Localisation: which node the robot is at."""

    distance: float = 1.1
    """D_l: greatest d of a node that the robot is at (paper)."""
    reachability: float = 0.5
    """Least r of a node that the robot is at (ours)."""
    follow_places: bool = True
    """Track all places that match the images, until later images decide between them. Once the place is certain, no
    perceptual alias is accepted as a node, a target or the goal (ours)."""
    doubt_after_failures: int = 3
    """Number of failed attempts from a node in one query after which localisation excludes it; 0 = never (ours)."""


@dataclass(frozen=True, slots=True)
class PlanningConfig:
    """Costs of a path."""

    belief_weight: float = 1.5
    """The cost of an edge is mu - weight * ln p; 0 is the paper's mu (ours)."""
    failure_penalty: float = 2.0
    """Additional cost of a failed edge for the rest of the query; 0 = none (ours)."""
    repeat_limit: int = 2
    """Maximum number of attempts at an edge in one query; further ones count as failed; 0 = no limit (ours)."""


@dataclass(frozen=True, slots=True)
class DrivingConfig:
    """The position-based controller, and the conditions for stopping it."""

    speed_m_s: float = 0.5
    """Maximum forward speed (paper: position-based feedback; the value is ours)."""
    look_every_steps: int = 20
    """Number of control steps after which the waypoint is predicted again; 0 = only at departure (ours)."""
    lost_reachability: float = 0.35
    """The attempt ends if a new prediction gives the subgoal a lower r than this (ours)."""
    departure_reachability: float = 0.4
    """Least r of the target at departure; below it the robot first approaches the node it is at; 0 = off (ours)."""
    through_map: bool = True
    """Use the edge's own waypoint if the node is in view but its successor is not (ours)."""
    depth_veto: bool = True
    """Refuse commands that would hit an obstacle in recent depth images (ours)."""
    swerve: bool = True
    """Drive through the middle of narrow ways, and steer around obstacles before a command is refused (ours)."""
    back_up_clearance_m: float = 0.28
    """Least clearance in metres of a way for backing up; on a narrower way the robot turns round; 0 = never (ours)."""
    bends: int = 3
    """Maximum number of detours in one attempt if steering around an obstacle does not help; 0 = never (ours)."""
    patience_s: float = 4.0
    """Maximum time in seconds that one attempt waits while something moves close ahead; 0 = never (ours)."""


@dataclass(frozen=True, slots=True)
class JudgingConfig:
    """Conditions for the success of an attempt and for arrival at the goal."""

    success_distance: float = 0.7
    """Greatest d of the target after a successful attempt. It is less than D_c, so that an attempt at a blocked short
    edge fails (ours); 0 = isConnectable, within D_c (paper)."""
    success_reachability: float = 0.5
    """Least r for a success (ours)."""
    arrive_distance: float = 0.45
    """Greatest d of a goal that is reached (ours)."""
    arrive_reachability: float = 0.6
    """Least r of a goal that is reached (ours)."""


@dataclass(frozen=True, slots=True)
class Likelihoods:
    """The constants of Eq. 3 and Eq. 4 that depend on the predictor, measured in simulation."""

    p_success_if_reachable: float
    """p(s | r), below 1 (paper)."""
    p_success_if_not: float
    """p(s | not r), above 0 (paper)."""
    sigma2: float
    """Variance of d as the predictor measures it (paper)."""


@dataclass(frozen=True, slots=True)
class BeliefConfig:
    """Eq. 3, Eq. 4 and pruning.

    `p_success_if_reachable`, `p_success_if_not` and `sigma2` are defaults for a predictor without measured values;
    `predictors.opening.open_method` replaces them by measured ones.
    """

    p_success_if_reachable: float = 0.85
    """p(s | r): probability of success on an edge that exists (paper; measured in simulation)."""
    p_success_if_not: float = 0.2
    """p(s | not r): probability of an apparent success on an edge that does not exist (paper)."""
    p_cap: float = 0.95
    """Upper limit of p (ours)."""
    sigma2: float = 0.02
    """Variance of the predicted d, for a new edge and for one measurement (paper)."""
    prune_below: float = 0.5
    """R_p: an edge is pruned if it failed and its p is below this (paper)."""
    one_failure_per_query: bool = True
    """Count all failures of an edge in one query as one (ours)."""
    hindered_weight: float = 0.15
    """Weight of a failure with an obstacle in the way, or after driving in circles, which then prunes only at a low p;
    1 is the paper's, which treats all failures alike (ours)."""
    prune_after_failures: int = 3
    """Least number of failures, in different queries, before an edge is pruned; 1 is the paper's (ours)."""
    failures_per_success: int = 2
    """Further failures needed per success, so that only edges that mostly fail are pruned; 0 is the paper's (ours)."""


@dataclass(frozen=True, slots=True)
class ExpansionConfig:
    """New nodes from novel images, and from left-over images if there is no path."""

    novel_after_looks: int = 12
    """Number of unrecognised observations after which one becomes a node; 1 = at once (paper), 0 = never (ours)."""
    search_reserve: bool = True
    """Search a path through left-over images if the map has none (paper); False = never (ours)."""
    strict: bool = True
    """Require that a left-over image passes R_c with temporal support and connects two nodes, and compare only those
    near the gap in time, each with the nodes nearest in time; False compares all, at random (ours)."""


@dataclass(frozen=True, slots=True)
class RecoveryConfig:
    """Behaviour of a robot that is lost or has no path, and limits of a query."""

    give_up_after_looks: int = 48
    """Number of consecutive observations without a node or a path that ends a query (ours)."""
    step_limit: int = 2000
    """K: maximum number of control steps in a query (paper: 1,000 in small maps, 2,000 in large ones)."""
    collision_limit: int = 20
    """Maximum number of collisions in a query (paper)."""


@dataclass(frozen=True, slots=True)
class Method:
    """All thresholds of building, localising, planning, driving and maintenance."""

    matching: MatchingConfig = field(default_factory=MatchingConfig)
    """Comparison of two images."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """Algorithm 1."""
    localising: LocalisingConfig = field(default_factory=LocalisingConfig)
    """Localisation."""
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    """Costs of a path."""
    driving: DrivingConfig = field(default_factory=DrivingConfig)
    """The controller."""
    judging: JudgingConfig = field(default_factory=JudgingConfig)
    """Success of an attempt and arrival at the goal."""
    believing: BeliefConfig = field(default_factory=BeliefConfig)
    """Eq. 3, Eq. 4 and pruning."""
    expanding: ExpansionConfig = field(default_factory=ExpansionConfig)
    """New nodes."""
    recovering: RecoveryConfig = field(default_factory=RecoveryConfig)
    """Recovery, and limits of a query."""
    maintain: bool = True
    """Update the map during navigation; False freezes it, as in the paper's first test."""


ROBUST = Method()
"""The default: the paper's method with the departures that are needed according to measurements."""

PAPER = Method(
    matching=MatchingConfig(reverse_within=2.5, temporal_support=False, mend_slips=False, closure_reach=0),
    building=BuildingConfig(
        merge_distance=0.55,
        connect_distance=1.5,
        bridges=False,
        odometry_drift=0.0,
        close_loops=False,
        floor_edges=False,
        keep_merged=False,
        largest_piece=False,
    ),
    localising=LocalisingConfig(follow_places=False, doubt_after_failures=0),
    planning=PlanningConfig(belief_weight=0.0, failure_penalty=0.0, repeat_limit=0),
    driving=DrivingConfig(
        patience_s=0.0,
        look_every_steps=0,
        departure_reachability=0.0,
        through_map=False,
        depth_veto=False,
        swerve=False,
        back_up_clearance_m=0.0,
        bends=0,
    ),
    judging=JudgingConfig(success_distance=0.0),
    believing=BeliefConfig(
        one_failure_per_query=False,
        hindered_weight=1.0,
        prune_after_failures=1,
        failures_per_success=0,
    ),
    expanding=ExpansionConfig(novel_after_looks=1, strict=False),
)
"""The literal method, without any departure."""

PRESETS: dict[str, Method] = {"robust": ROBUST, "paper": PAPER}
"""Presets by their names on the command line."""


def preset(name: str) -> Method:
    """Return the thresholds of a preset.

    Args:
        name: `robust`, the default, or `paper`, the literal method.

    Raises:
        OptionError: No preset has that name; the message lists all names.
    """
    try:
        return PRESETS[name.lower()]
    except KeyError:
        raise OptionError(f"No method is called {name!r}. {which_name(name, PRESETS)}.") from None
