"""Failed queries by failure mode and place, the second before, and success over queries with its dips."""

import pytest

from ltvn_core.analysis.failure_triage import FailureMode, failed_queries, group_by_failure_mode, group_by_place
from ltvn_core.analysis.lifelong_success import lifelong_success
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.navigation.events import (
    AttemptEnd,
    Collided,
    Judged,
    Note,
    Outcome,
    Planned,
    QueryStarted,
    Severity,
    StampedEvent,
)
from tests.core.analysis import example_runs
from tests.repository import DEMO_DRIVE


def query(number: int, begin: int, outcome: Outcome, *, reached: bool, place: int | None = 0) -> list[StampedEvent]:
    """A query of ten steps in which the robot only looks once."""
    fix, plan = example_runs.localised(number, begin, place), Planned(number, (0, 1, 2), 2.0)
    return [
        *example_runs.at(begin, QueryStarted(number, 2), fix, plan),
        *example_runs.at(begin + 10, example_runs.ended(number, 2, outcome), Judged(number, reached, 1.0, 0.0)),
    ]


def series(verdicts: str) -> Timeline:
    """Queries one after the other, `+` reached and `-` not."""
    run = example_runs.square()
    for number, verdict in enumerate(verdicts):
        run += query(number, 20 + 20 * number, Outcome.ARRIVED, reached=verdict == "+")
    return Timeline.of(run)


def test_a_drive_without_failures_has_none() -> None:
    assert failed_queries(Timeline.of(Recording.open(DEMO_DRIVE).events)) == ()


def test_a_failed_query_is_shown_a_second_before_it_went_wrong_for_good() -> None:
    (failure,) = failed_queries(example_runs.timeline())
    assert (failure.query.id, failure.failure_mode) == (0, FailureMode.OBSTRUCTED)
    assert failure.ending == "step limit"
    assert failure.text == "Collision 1 of query 0."
    assert (failure.instant.step, failure.instant.stamp) == (45, pytest.approx(4.5))
    assert (failure.edge, failure.node) == ((1, 2), 1)
    assert failure.pose is not None
    assert failure.pose.x_m == 1.0


def test_a_setback_after_which_the_robot_came_nearer_than_ever_is_recovered_from() -> None:
    early, late = example_runs.attempt_started(0, 1, 0, 1, 20), example_runs.attempt_started(0, 2, 1, 2, 60)
    run = [
        *example_runs.square(),
        *example_runs.at(20, QueryStarted(0, 2), example_runs.localised(0, 20, 0), Planned(0, (0, 1, 2), 2.0), early),
        *example_runs.at(
            40, example_runs.failed(early, 40), example_runs.localised(0, 40, 0), Planned(0, (0, 1, 2), 2.0)
        ),
        *example_runs.at(60, example_runs.localised(0, 60, 1), Planned(0, (1, 2), 1.0), late),
        *example_runs.at(
            80, example_runs.failed(late, 80), example_runs.localised(0, 80, 0), Planned(0, (0, 1, 2), 2.0)
        ),
        *example_runs.at(
            90, example_runs.localised(0, 90, 1), Planned(0, (1, 2), 1.0), example_runs.ended(0, 2, Outcome.STEP_LIMIT)
        ),
    ]
    (failure,) = failed_queries(Timeline.of(run))
    assert (failure.instant.step, failure.edge) == (70, (1, 2))


def test_too_many_collisions_are_put_where_most_happened() -> None:
    first, second = example_runs.attempt_started(0, 1, 0, 1, 20), example_runs.attempt_started(0, 2, 1, 2, 60)
    run = [
        *example_runs.square(),
        *example_runs.at(20, QueryStarted(0, 2), example_runs.localised(0, 20, 0), Planned(0, (0, 1, 2), 2.0), first),
        *example_runs.at(35, Collided(0, 1)),
        *example_runs.at(
            40, example_runs.failed(first, 40), example_runs.localised(0, 60, 1), Planned(0, (1, 2), 1.0), second
        ),
        *example_runs.at(70, Collided(0, 2)),
        *example_runs.at(75, Collided(0, 3)),
        *example_runs.at(80, example_runs.failed(second, 80), example_runs.ended(0, 2, Outcome.COLLISION_LIMIT)),
    ]
    (failure,) = failed_queries(Timeline.of(run))
    assert (failure.failure_mode, failure.node, failure.instant.step) == (FailureMode.OBSTRUCTED, 1, 60)


@pytest.mark.parametrize(
    ("outcome", "failure_mode"),
    [
        (Outcome.ARRIVED, FailureMode.FALSE_EDGE),
        (Outcome.LOST, FailureMode.NOT_RECOGNISED),
        (Outcome.NO_PATH, FailureMode.NOT_RECOGNISED),
        (Outcome.COLLISION_LIMIT, FailureMode.OBSTRUCTED),
        (Outcome.STEP_LIMIT, FailureMode.NOT_RECOGNISED),
    ],
)
def test_the_end_of_a_query_names_the_cause_where_nothing_went_wrong_before(
    outcome: Outcome, failure_mode: FailureMode
) -> None:
    run = [*example_runs.square(), *query(0, 20, outcome, reached=False, place=None)]
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.failure_mode is failure_mode
    assert failure.ending == ("wrong arrival" if outcome is Outcome.ARRIVED else outcome)
    assert failure.instant.step == 20
    assert (failure.node, failure.pose) == (None, None)


@pytest.mark.parametrize(
    ("end", "failure_mode"),
    [
        (AttemptEnd.COLLISION, FailureMode.OBSTRUCTED),
        (AttemptEnd.BLOCKED, FailureMode.OBSTRUCTED),
        (AttemptEnd.REACHED, FailureMode.ODOMETRY),
        (AttemptEnd.TIMEOUT, FailureMode.FALSE_EDGE),
        (AttemptEnd.LOST, FailureMode.NOT_RECOGNISED),
    ],
)
def test_the_failed_leg_at_which_a_query_began_to_go_wrong_names_the_cause(
    end: AttemptEnd, failure_mode: FailureMode
) -> None:
    begun = example_runs.attempt_started(0, 1, 0, 1, 22)
    run = [*example_runs.square(), *query(0, 20, Outcome.STEP_LIMIT, reached=False)]
    run[-2:-2] = [*example_runs.at(22, begun), *example_runs.at(26, example_runs.failed(begun, 26, end))]
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.failure_mode is failure_mode


def test_a_query_is_called_by_its_own_outcome_whatever_cost_its_steps() -> None:
    lost = [
        stamped for step in range(21, 28) for stamped in example_runs.at(step, example_runs.localised(0, step, None))
    ]
    run = sorted(
        [*example_runs.square(), *query(0, 20, Outcome.STEP_LIMIT, reached=False), *lost], key=lambda at: at.step
    )
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.ending == Outcome.STEP_LIMIT


def test_a_denied_arrival_counts_as_a_setback() -> None:
    denial = Note("The place looked like the goal, but the goal is elsewhere.", Severity.WARN)
    run = [*example_runs.square(), *query(0, 20, Outcome.STEP_LIMIT, reached=False)]
    run[-2:-2] = example_runs.at(28, denial)
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.text == denial.text


def test_without_a_verdict_what_the_robot_says_counts() -> None:
    run = [stamped for stamped in example_runs.two_failures() if not isinstance(stamped.event, Judged)]
    assert [failure.query.id for failure in failed_queries(Timeline.of(run))] == [0]


def test_cut_and_cancelled_queries_have_not_failed() -> None:
    run = [
        *example_runs.square(),
        *query(0, 20, Outcome.CANCELLED, reached=False),
        *example_runs.at(50, QueryStarted(1, 2)),
    ]
    assert failed_queries(Timeline.of(run)) == ()


def test_failures_are_grouped_by_failure_mode_and_by_place() -> None:
    run = example_runs.square()
    for number, (outcome, place) in enumerate(
        [(Outcome.LOST, 0), (Outcome.ARRIVED, 3), (Outcome.LOST, 1), (Outcome.LOST, None)]
    ):
        run += query(number, 20 + 20 * number, outcome, reached=False, place=place)
    failures = failed_queries(Timeline.of(run))
    assert {failure_mode: len(group) for failure_mode, group in group_by_failure_mode(failures).items()} == {
        FailureMode.NOT_RECOGNISED: 3,
        FailureMode.FALSE_EDGE: 1,
    }
    places = group_by_place(failures, radius_m=1.5)
    assert [place.nodes for place in places] == [(0, 1), (3,), ()]


def test_the_strip_counts_success_and_what_became_of_the_map() -> None:
    strip = lifelong_success(example_runs.timeline(), window=2)
    assert strip.queries.tolist() == [0, 1]
    assert strip.succeeded.tolist() == [False, True]
    assert strip.success.tolist() == [0.0, 0.5]
    assert strip.nodes.tolist() == [4, 4]
    assert strip.edges.tolist() == [4, 3]
    assert strip.pruned.tolist() == [0, 1]
    assert strip.edges_added.tolist() == [0, 0]


def test_a_dip_names_the_queries_between_which_to_compare_the_map() -> None:
    strip = lifelong_success(series("++++++--+-++++++"), window=4)
    (dip,) = strip.dips
    assert (dip.first, dip.last, dip.peak, dip.low) == (6, 12, 5, 9)
    assert dip.fall == pytest.approx(0.75)
    assert (dip.before, dip.after) == (strip.ends[5], strip.ends[9])


def test_steady_success_and_few_queries_have_no_dips() -> None:
    assert lifelong_success(series("++++++"), window=4).dips == ()
    assert lifelong_success(series("+-"), window=4).dips == ()
    assert lifelong_success(Timeline.of([])).dips == ()


def test_a_window_of_no_queries_is_refused() -> None:
    with pytest.raises(OptionError, match="at least 1"):
        lifelong_success(example_runs.timeline(), window=0)
