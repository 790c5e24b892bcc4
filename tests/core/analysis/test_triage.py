"""Failed queries by failure mode and place, the second before, and success over queries with its dips."""

import pytest

from ltvn_core.analysis.failure_triage import FailureMode, failed_queries, group_by_failure_mode, group_by_place
from ltvn_core.analysis.lifelong_success import lifelong_success
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.errors import OptionError
from ltvn_core.navigation import events as e
from tests.core.analysis import example_runs as runs


def query(number: int, begin: int, outcome: e.Outcome, *, reached: bool, place: int | None = 0) -> list[e.StampedEvent]:
    """A query of ten steps in which the robot only looks once."""
    fix, plan = runs.localised(number, begin, place), e.Planned(number, (0, 1, 2), 2.0)
    return [
        *runs.at(begin, e.QueryStarted(number, 2), fix, plan),
        *runs.at(begin + 10, runs.ended(number, 2, outcome), e.Judged(number, reached, 1.0, 0.0)),
    ]


def series(verdicts: str) -> Timeline:
    """Queries one after the other, `+` reached and `-` not."""
    run = runs.square()
    for number, verdict in enumerate(verdicts):
        run += query(number, 20 + 20 * number, e.Outcome.ARRIVED, reached=verdict == "+")
    return Timeline.of(run)


def test_a_setback_after_which_the_robot_came_nearer_than_ever_is_recovered_from() -> None:
    early, late = runs.attempt_started(0, 1, 0, 1, 20), runs.attempt_started(0, 2, 1, 2, 60)
    run = [
        *runs.square(),
        *runs.at(20, e.QueryStarted(0, 2), runs.localised(0, 20, 0), e.Planned(0, (0, 1, 2), 2.0), early),
        *runs.at(40, runs.failed(early, 40), runs.localised(0, 40, 0), e.Planned(0, (0, 1, 2), 2.0)),
        *runs.at(60, runs.localised(0, 60, 1), e.Planned(0, (1, 2), 1.0), late),
        *runs.at(80, runs.failed(late, 80), runs.localised(0, 80, 0), e.Planned(0, (0, 1, 2), 2.0)),
        *runs.at(90, runs.localised(0, 90, 1), e.Planned(0, (1, 2), 1.0), runs.ended(0, 2, e.Outcome.STEP_LIMIT)),
    ]
    (failure,) = failed_queries(Timeline.of(run))
    assert (failure.instant.step, failure.edge) == (70, (1, 2))


def test_too_many_collisions_are_put_where_most_happened() -> None:
    first, second = runs.attempt_started(0, 1, 0, 1, 20), runs.attempt_started(0, 2, 1, 2, 60)
    run = [
        *runs.square(),
        *runs.at(20, e.QueryStarted(0, 2), runs.localised(0, 20, 0), e.Planned(0, (0, 1, 2), 2.0), first),
        *runs.at(35, e.Collided(0, 1)),
        *runs.at(40, runs.failed(first, 40), runs.localised(0, 60, 1), e.Planned(0, (1, 2), 1.0), second),
        *runs.at(70, e.Collided(0, 2)),
        *runs.at(75, e.Collided(0, 3)),
        *runs.at(80, runs.failed(second, 80), runs.ended(0, 2, e.Outcome.COLLISION_LIMIT)),
    ]
    (failure,) = failed_queries(Timeline.of(run))
    assert (failure.failure_mode, failure.node, failure.instant.step) == (FailureMode.OBSTRUCTED, 1, 60)


@pytest.mark.parametrize(
    ("outcome", "failure_mode"),
    [
        (e.Outcome.ARRIVED, FailureMode.FALSE_EDGE),
        (e.Outcome.LOST, FailureMode.NOT_RECOGNISED),
        (e.Outcome.NO_PATH, FailureMode.NOT_RECOGNISED),
        (e.Outcome.COLLISION_LIMIT, FailureMode.OBSTRUCTED),
        (e.Outcome.STEP_LIMIT, FailureMode.NOT_RECOGNISED),
    ],
)
def test_the_end_of_a_query_names_the_cause_where_nothing_went_wrong_before(
    outcome: e.Outcome, failure_mode: FailureMode
) -> None:
    run = [*runs.square(), *query(0, 20, outcome, reached=False, place=None)]
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.failure_mode is failure_mode
    assert failure.ending == ("wrong arrival" if outcome is e.Outcome.ARRIVED else outcome)
    assert failure.instant.step == 20
    assert (failure.node, failure.pose) == (None, None)


@pytest.mark.parametrize(
    ("end", "failure_mode"),
    [
        (e.AttemptEnd.COLLISION, FailureMode.OBSTRUCTED),
        (e.AttemptEnd.BLOCKED, FailureMode.OBSTRUCTED),
        (e.AttemptEnd.REACHED, FailureMode.ODOMETRY),
        (e.AttemptEnd.TIMEOUT, FailureMode.FALSE_EDGE),
        (e.AttemptEnd.LOST, FailureMode.NOT_RECOGNISED),
    ],
)
def test_the_failed_leg_at_which_a_query_began_to_go_wrong_names_the_cause(
    end: e.AttemptEnd, failure_mode: FailureMode
) -> None:
    begun = runs.attempt_started(0, 1, 0, 1, 22)
    run = [*runs.square(), *query(0, 20, e.Outcome.STEP_LIMIT, reached=False)]
    run[-2:-2] = [*runs.at(22, begun), *runs.at(26, runs.failed(begun, 26, end))]
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.failure_mode is failure_mode


def test_a_query_is_called_by_its_own_outcome_whatever_cost_its_steps() -> None:
    lost = [stamped for step in range(21, 28) for stamped in runs.at(step, runs.localised(0, step, None))]
    run = sorted([*runs.square(), *query(0, 20, e.Outcome.STEP_LIMIT, reached=False), *lost], key=lambda at: at.step)
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.ending == e.Outcome.STEP_LIMIT


def test_a_denied_arrival_counts_as_a_setback() -> None:
    denial = e.Note("The place looked like the goal, but the goal is elsewhere.", e.Severity.WARN)
    run = [*runs.square(), *query(0, 20, e.Outcome.STEP_LIMIT, reached=False)]
    run[-2:-2] = runs.at(28, denial)
    (failure,) = failed_queries(Timeline.of(run))
    assert failure.text == denial.text


def test_without_a_verdict_what_the_robot_says_counts() -> None:
    run = [stamped for stamped in runs.two_failures() if not isinstance(stamped.event, e.Judged)]
    assert [failure.query.id for failure in failed_queries(Timeline.of(run))] == [0]


def test_cut_and_cancelled_queries_have_not_failed() -> None:
    run = [*runs.square(), *query(0, 20, e.Outcome.CANCELLED, reached=False), *runs.at(50, e.QueryStarted(1, 2))]
    assert failed_queries(Timeline.of(run)) == ()


def test_failures_are_grouped_by_failure_mode_and_by_place() -> None:
    run = runs.square()
    for number, (outcome, place) in enumerate(
        [(e.Outcome.LOST, 0), (e.Outcome.ARRIVED, 3), (e.Outcome.LOST, 1), (e.Outcome.LOST, None)]
    ):
        run += query(number, 20 + 20 * number, outcome, reached=False, place=place)
    failures = failed_queries(Timeline.of(run))
    assert {failure_mode: len(group) for failure_mode, group in group_by_failure_mode(failures).items()} == {
        FailureMode.NOT_RECOGNISED: 3,
        FailureMode.FALSE_EDGE: 1,
    }
    places = group_by_place(failures, radius_m=1.5)
    assert [[each.node for each in place] for place in places] == [[0, 1], [3], [None]]


def test_the_strip_counts_success_and_what_became_of_the_map() -> None:
    strip = lifelong_success(runs.timeline(), window=2)
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
    assert (dip.peak, dip.low) == (5, 9)
    assert dip.fall == pytest.approx(0.75)
    assert (dip.before, dip.after) == (strip.ends[5], strip.ends[9])


def test_steady_success_and_few_queries_have_no_dips() -> None:
    assert lifelong_success(series("++++++"), window=4).dips == ()
    assert lifelong_success(series("+-"), window=4).dips == ()
    assert lifelong_success(Timeline.of([])).dips == ()


def test_a_window_of_no_queries_is_refused() -> None:
    with pytest.raises(OptionError, match="at least 1"):
        lifelong_success(runs.timeline(), window=0)
