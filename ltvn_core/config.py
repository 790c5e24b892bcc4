"""Every threshold of the method, in one frozen dataclass, with two presets.

`PAPER` is the literal method: every departure is off. `ROBUST`, the default, switches on what measurement showed to be
needed; each departure is one named field. The authors published no values, so every number is ours; a docstring that
says "paper" means that the quantity is theirs, "ours" that the quantity itself is a departure or a gap we filled.

Distances d are Eq. 2, which mixes metres with sqrt(2) per radian. Owns no behaviour.
"""

import math
from dataclasses import dataclass, field

from ltvn_core.errors import OptionError
from ltvn_core.terminal_text import which_name


@dataclass(frozen=True, slots=True)
class MatchingConfig:
    """How two images are compared."""

    both_directions: bool = True
    """Ask the network both ways and keep the more reachable answer, its waypoint inverted if need be; our reading
    of the paper's "only targets in front are positive, the way back is driven in reverse", on in both presets."""
    reverse_within: float = 1.5
    """Only nodes that seem nearer than this d are asked about the other way; must exceed D_c and D_l (ours)."""
    temporal_support: bool = True
    """Trust r only as far as the median with the frames before and after both images agrees (ours)."""
    support_gap: float = 0.8
    """d by odometry within which two frames of a recording count as neighbours in time (ours)."""
    mend_slips: bool = True
    """Put odometry right where two depth images in a row say that the wheels slipped (ours)."""
    closure_reach: int = 10
    """An edge between two passes of a drive must hold for so many images around its ends too; 0 = off (ours)."""
    closure_share: float = 0.5
    """Share of the images asked about that must lie as the edge foretells (ours)."""


@dataclass(frozen=True, slots=True)
class BuildingConfig:
    """Algorithm 1: from a trajectory to a map."""

    merge_distance: float = 0.55
    """D_m: an image nearer than this to a node adds nothing (paper)."""
    merge_reachability: float = 0.6
    """Least r for merging (ours)."""
    merge_yaw_rad: float = 0.45
    """Images turned by more than this never merge; pi switches the gate off (ours)."""
    connect_distance: float = 1.0
    """D_c: two images nearer than this are joined by an edge (paper)."""
    connect_reachability: float = 0.8
    """R_c: least r for an edge (ours; the paper leaves it open)."""
    second_pass_reachability: float = 0.6
    """Least r for images that are left over after Algorithm 1; 0 switches the second pass off (ours)."""
    second_pass_edges: int = 2
    """Edges that a left-over image may get, the most reachable ones first (ours)."""
    bridges: bool = True
    """Images left over after the second pass may be connected with merged ones, which become nodes then, and where no
    image helps, with the next image of the drive by odometry (ours)."""
    tie_goals: bool = True
    """Goals that are left over even then are joined by odometry along the drive, and where that knows no way, with the
    image that agrees with them best, as an edge that is hardly believed (ours)."""
    odometry_drift: float = 0.04
    """Metres that odometry may drift per metre driven; what contradicts it by more is no edge. 0 = not used (ours)."""
    close_loops: bool = True
    """Correct the drive's odometry where it passes a place again, before anything is compared by it (ours)."""
    floor_edges: bool = True
    """Join nodes with free floor between them that no image joins, where that makes a way much shorter (ours)."""
    keep_merged: bool = True
    """Keep merged images in the reserve T', which Algorithm 1 would otherwise leave nearly empty (ours)."""
    largest_piece: bool = True
    """Begin again among the images left over while they could make a larger piece, and keep the largest (ours)."""


@dataclass(frozen=True, slots=True)
class LocalisingConfig:
    """Which node the robot is at."""

    distance: float = 1.1
    """D_l: a node farther away than this is not where the robot is (paper)."""
    reachability: float = 0.5
    """Least r for a node to be where the robot is (ours)."""
    reachability_weight: float = 1.5
    """The score is d - weight * ln r; 0 is the paper's nearest node (ours)."""
    follow_places: bool = True
    """Follow all places that images resemble until what is seen on the way tells which it is. Where that is sure, no
    look-alike is taken for a node, a target or the goal (ours)."""
    doubt_after_failures: int = 3
    """Failed attempts in one query after which the robot does not believe to be where they began; 0 = never (ours)."""


@dataclass(frozen=True, slots=True)
class PlanningConfig:
    """What a path costs."""

    belief_weight: float = 1.5
    """An edge costs mu - weight * ln p; 0 is the paper's mu (ours)."""
    failure_penalty: float = 2.0
    """What an edge that failed costs more for the rest of the query; 0 forgets at once (ours)."""
    repeat_limit: int = 2
    """An edge driven more often than this in one query has failed, whatever it looks like; 0 = no limit (ours)."""


@dataclass(frozen=True, slots=True)
class DrivingConfig:
    """The position-based controller and what makes it stop."""

    speed_m_s: float = 0.5
    """Greatest forward speed (paper: position-based feedback; the value is ours)."""
    turn_rad_s: float = 1.0
    """Greatest turning rate (ours)."""
    position_tolerance_m: float = 0.08
    """A waypoint nearer than this is reached (ours)."""
    yaw_tolerance_rad: float = 0.06
    """The final turn ends within this (ours)."""
    leg_steps: int = 100
    """Control steps of 0.1 s that an attempt may take (ours)."""
    look_every_steps: int = 20
    """Predict the waypoint anew after so many control steps; 0 = once, at departure (ours)."""
    lost_reachability: float = 0.35
    """A subgoal that falls below this on the way ends the attempt; used only where it is predicted anew (ours)."""
    departure_reachability: float = 0.4
    """Below this r at departure the robot goes to the node it is at first; 0 = it just sets off (ours)."""
    through_map: bool = True
    """Where the node is in sight but its successor is not, aim along the edge's own waypoint (ours)."""
    depth_veto: bool = True
    """Refuse a command that would hit what the last depth images showed (ours)."""
    swerve: bool = True
    """Steer such a command aside before refusing it (ours)."""
    back_up_clearance_m: float = 0.28
    """The robot turns round rather than back up where anything is nearer than this to the way; 0 = never (ours)."""
    bends: int = 3
    """Detours that one attempt may take where steering aside does not help; 0 = never (ours)."""
    veto_margin_m: float = 0.04
    """How much wider than the robot the way must be (ours)."""
    patience_s: float = 4.0
    """How long one attempt waits while something moves close ahead; 0 = never (ours)."""
    back_off_m: float = 0.25
    """How far to back off after a collision (ours; the paper says nothing)."""


@dataclass(frozen=True, slots=True)
class JudgingConfig:
    """When an attempt succeeded and when the goal is reached."""

    success_distance: float = 0.7
    """An attempt succeeded if its target is nearer than this, so that it fails where something blocks a short edge
    (ours); 0 = isConnectable, within D_c (paper)."""
    success_reachability: float = 0.5
    """Least r for a success (ours)."""
    arrive_distance: float = 0.45
    """The goal is reached when it is nearer than this (ours)."""
    arrive_reachability: float = 0.6
    """Least r for the goal to be reached (ours)."""
    arrive_yaw_rad: float = 0.25
    """Greatest yaw to the goal; pi switches the gate off (ours)."""


@dataclass(frozen=True, slots=True)
class Likelihoods:
    """The constants of Eq. 3 and Eq. 4 that depend on the predictor, measured in simulation by `ltvn measure`."""

    p_success_if_reachable: float
    """p(s | r), below 1 (paper)."""
    p_success_if_not: float
    """p(s | not r), above 0 (paper)."""
    sigma2: float
    """Variance of d as the predictor measures it (paper)."""


@dataclass(frozen=True, slots=True)
class BeliefConfig:
    """Eq. 3, Eq. 4 and pruning.

    The first two and `sigma2` hold for a predictor that nobody measured; `predictors.opening.open_method` puts the
    measured ones in their place.
    """

    p_success_if_reachable: float = 0.85
    """p(s | r): how often an edge that exists is driven with success (paper; measured in simulation)."""
    p_success_if_not: float = 0.2
    """p(s | not r): how often an edge that does not exist seems to be driven with success (paper)."""
    p_cap: float = 0.95
    """No belief is ever more certain than this (ours)."""
    sigma2: float = 0.02
    """Variance of d as the network predicts it: of a new edge and of one measurement (paper)."""
    prune_below: float = 0.5
    """R_p: an edge that failed and whose p fell below this leaves the map (paper)."""
    one_failure_per_query: bool = True
    """However often an edge fails in one query, that is one piece of evidence (ours)."""
    hindered_weight: float = 0.15
    """What a failure counts where something stood in the way or the robot went in circles; 1 is the paper's (ours)."""
    hindered_prune_below: float = 0.05
    """R_p where something stood in the way, for which it takes a long run of failures; `prune_below` is the paper's."""
    prune_after_failures: int = 3
    """Failures in different queries before an edge may leave; 1 is the paper's (ours)."""
    failures_per_success: int = 2
    """So many failures more for each success, so that only what mostly fails may leave; 0 is the paper's (ours)."""


@dataclass(frozen=True, slots=True)
class ExpansionConfig:
    """New nodes: novel images, and left-over images when there is no path."""

    novel_after_looks: int = 12
    """Unrecognised observations before the current one becomes a node; 1 = at once (paper), 0 = never (ours)."""
    connect_factor: float = 1.3
    """D_c grows by this for novel nodes (paper)."""
    merge_factor: float = 0.6
    """D_m shrinks by this for novel nodes (paper)."""
    search_reserve: bool = True
    """Search a path through left-over images where the map has none (paper); False = never (ours)."""
    strict: bool = True
    """Left-over images must pass R_c with temporal support and connect two nodes (ours)."""
    sample_limit: int = 60
    """Left-over images tried in one search, temporal neighbours of the gap first; 0 = all, at random (ours)."""
    neighbour_limit: int = 24
    """Nodes, nearest in time first, that a left-over image is compared with; 0 = all (ours)."""


@dataclass(frozen=True, slots=True)
class RecoveryConfig:
    """What the robot does when it is lost or sees no path, and when it gives up."""

    turn_rad: float = 0.52
    """Turn on the spot between two observations (paper: it turns; the value is ours)."""
    looks_per_turn: int = 12
    """Observations in a full turn (ours)."""
    wander_m: float = 0.3
    """How far to drive ahead after a full turn without success; 0 = never (ours)."""
    give_up_after_looks: int = 48
    """Unrecognised observations in a row that end a query (ours)."""
    step_limit: int = 2000
    """K: control steps that end a query (paper: 1,000 in small maps, 2,000 in large ones)."""
    collision_limit: int = 20
    """More collisions than this end a query (paper)."""


@dataclass(frozen=True, slots=True)
class Method:
    """All thresholds of building, localising, planning, driving and maintenance."""

    matching: MatchingConfig = field(default_factory=MatchingConfig)
    """How two images are compared."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """Algorithm 1."""
    localising: LocalisingConfig = field(default_factory=LocalisingConfig)
    """Which node the robot is at."""
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    """What a path costs."""
    driving: DrivingConfig = field(default_factory=DrivingConfig)
    """The controller."""
    judging: JudgingConfig = field(default_factory=JudgingConfig)
    """When an attempt succeeded."""
    believing: BeliefConfig = field(default_factory=BeliefConfig)
    """Eq. 3, Eq. 4 and pruning."""
    expanding: ExpansionConfig = field(default_factory=ExpansionConfig)
    """New nodes."""
    recovering: RecoveryConfig = field(default_factory=RecoveryConfig)
    """Lost, no path, giving up."""
    maintain: bool = True
    """Change the map while navigating; False freezes it, as the paper's first test does."""


ROBUST = Method()
"""The default: the paper's method with every departure that measurement showed to be needed."""

PAPER = Method(
    matching=MatchingConfig(reverse_within=2.5, temporal_support=False, mend_slips=False, closure_reach=0),
    building=BuildingConfig(
        merge_distance=0.55,
        connect_distance=1.5,
        merge_yaw_rad=math.pi,
        second_pass_reachability=0.0,
        bridges=False,
        tie_goals=False,
        odometry_drift=0.0,
        close_loops=False,
        floor_edges=False,
        keep_merged=False,
        largest_piece=False,
    ),
    localising=LocalisingConfig(reachability_weight=0.0, follow_places=False, doubt_after_failures=0),
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
        back_off_m=0.1,
    ),
    judging=JudgingConfig(success_distance=0.0, arrive_yaw_rad=math.pi),
    believing=BeliefConfig(
        one_failure_per_query=False,
        hindered_weight=1.0,
        hindered_prune_below=0.5,
        prune_after_failures=1,
        failures_per_success=0,
    ),
    expanding=ExpansionConfig(novel_after_looks=1, strict=False, sample_limit=0, neighbour_limit=0),
    recovering=RecoveryConfig(wander_m=0.0),
)
"""The literal method: every departure is off."""

PRESETS: dict[str, Method] = {"robust": ROBUST, "paper": PAPER}
"""The presets by the names the command line knows."""


def preset(name: str) -> Method:
    """Return the thresholds of the method by the name of a preset.

    Args:
        name: `robust`, which is the default everywhere, or `paper`, the literal method.

    Raises:
        OptionError: No preset has that name; the message lists those there are.
    """
    try:
        return PRESETS[name.lower()]
    except KeyError:
        raise OptionError(f"No method is called {name!r}. {which_name(name, PRESETS)}.") from None
