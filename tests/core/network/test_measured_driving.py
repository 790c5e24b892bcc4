"""The constants of Eq. 3 and Eq. 4: their statistics, their place in the card, and that the method takes them."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.config import ROBUST, Likelihoods, preset
from ltvn_core.errors import WeightsError
from ltvn_core.graph.operators import update_existence
from ltvn_core.network.driving_calibration import (
    DRIVING_SECTION,
    DrivingMeasurements,
    likelihoods,
    measured_likelihoods,
    read_driving,
)
from ltvn_core.network.metrics import SuccessRate, calibration_table
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.weights_file import card_path, read_card
from ltvn_core.predictors.opening import open_method, open_predictor
from ltvn_core.simulation import oracle_predictor
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.oracle_predictor import OraclePredictor
from tests.core.flat_world import FlatPredictor, one_room
from tools.measure_driving import add_to_card, error_table

COUNTS = st.integers(0, 400).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials)))


def measured(*, there: int = 19, not_there: int = 1, sigma: float = 0.05) -> DrivingMeasurements:
    """Return a measurement of 20 attempts of each kind."""
    good, bad = SuccessRate.of(there, 20), SuccessRate.of(not_there, 20)
    r, truth = np.linspace(0, 1, 30), np.arange(30) > 14
    errors = error_table((0.0, 1.0, 2.0), r, r / 10)
    table = calibration_table(r, truth)
    return DrivingMeasurements(
        "a command", ("tune-3",), 90, good, bad, good, bad, 2, 1, sigma, 2 * sigma, table, errors, errors
    )


@given(COUNTS)
def test_wilsons_interval_holds_the_share_and_stays_a_probability(counts: tuple[int, int]) -> None:
    rate = SuccessRate.of(*counts)
    assert 0 <= rate.low <= rate.share + 1e-12
    assert rate.share - 1e-12 <= rate.high <= 1


@given(COUNTS)
def test_laplaces_estimate_is_never_certain_and_lies_between_the_share_and_a_half(counts: tuple[int, int]) -> None:
    rate = SuccessRate.of(*counts)
    assert 0 < rate.shrunk < 1
    assert min(rate.share, 0.5) - 1e-12 <= rate.shrunk <= max(rate.share, 0.5) + 1e-12


@given(COUNTS, st.integers(2, 5))
def test_more_trials_with_the_same_share_make_it_surer(counts: tuple[int, int], times: int) -> None:
    few, many = SuccessRate.of(*counts), SuccessRate.of(counts[0] * times, counts[1] * times)
    assert many.high - many.low <= few.high - few.low


def test_wilsons_interval_is_the_textbooks() -> None:
    rate = SuccessRate.of(8, 10)
    assert (rate.low, rate.high) == pytest.approx((0.4902, 0.9433), abs=1e-4)


def test_more_successes_than_trials_are_refused() -> None:
    with pytest.raises(ValueError, match="between 0 and the 3 trials"):
        SuccessRate.of(4, 3)


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), max_size=60))
def test_every_pair_is_in_one_bin_of_the_calibration(pairs: list[tuple[float, bool]]) -> None:
    r = np.array([pair[0] for pair in pairs], float)
    truth = np.array([pair[1] for pair in pairs], bool)
    table = calibration_table(r, truth)
    assert sum(row.pairs for row in table) == len(pairs)
    assert sum(row.pairs * (row.reachable or 0) for row in table) == pytest.approx(truth.sum())


def test_errors_are_sorted_into_bins_and_empty_ones_say_so() -> None:
    near, far = error_table((0.0, 1.0, 2.0), np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.6]))
    assert (near.pairs, near.position_median_m) == (3, pytest.approx(0.2))
    assert (far.pairs, far.position_median_m, far.position_p90_m) == (0, None, None)


@pytest.mark.parametrize(("there", "not_there"), [(20, 0), (11, 10), (1, 0)])
def test_one_attempt_never_settles_whether_an_edge_exists(there: int, not_there: int) -> None:
    constants = likelihoods(measured(there=there, not_there=not_there, sigma=0.0))
    believing = replace(ROBUST.believing, **asdict(constants))
    assert (
        0
        < update_existence(0.5, believing, succeeded=False)
        < 0.5
        < update_existence(0.5, believing, succeeded=True)
        < 1
    )
    assert constants.sigma2 > 0


def test_where_no_false_edge_could_be_driven_a_success_still_speaks_for_an_edge() -> None:
    none = SuccessRate.of(0, 0)
    constants = likelihoods(replace(measured(there=20), success_if_not=none, arrival_if_not=none))
    assert constants.p_success_if_not == ROBUST.believing.p_success_if_not


def test_the_geometric_predictor_brings_what_was_measured_of_it() -> None:
    constants = open_method("robust", open_predictor("geometric")).believing
    assert constants.p_success_if_not < 0.5 < constants.p_success_if_reachable < 1
    assert 0 < constants.sigma2 < 0.01


def test_weights_whose_successes_mean_nothing_are_refused() -> None:
    with pytest.raises(WeightsError, match="cannot maintain a map"):
        likelihoods(measured(there=3, not_there=3))


def test_a_card_gives_back_what_was_written_and_keeps_its_other_parts(tmp_path: Path) -> None:
    weights = tmp_path / "own.safetensors"
    weights.write_bytes(b"weights")
    add_to_card(weights, "steps", {"count": 3})
    add_to_card(weights, DRIVING_SECTION, asdict(measured()))
    assert read_driving(read_card(weights)) == measured()
    assert read_card(weights)["steps"] == {"count": 3}


def test_a_card_without_a_measurement_leaves_the_presets_own_constants(tmp_path: Path) -> None:
    assert read_driving({"steps": 3}) is None
    assert measured_likelihoods(tmp_path / "unknown.safetensors") is None
    assert open_method("robust", FlatPredictor(one_room())) == ROBUST


def test_fine_tuned_weights_that_nobody_measured_inherit_their_parents_constants() -> None:
    section = json.loads(json.dumps(asdict(measured())))
    assert read_driving({"parent_card": {DRIVING_SECTION: section}}) == measured()
    assert read_driving({"parent_card": {"steps": 3}}) is None


def test_a_card_of_other_weights_is_neither_written_nor_believed(tmp_path: Path) -> None:
    weights = tmp_path / "own.safetensors"
    weights.write_bytes(b"old weights")
    add_to_card(weights, DRIVING_SECTION, asdict(measured()))
    weights.write_bytes(b"new weights")
    with pytest.raises(WeightsError, match="not to the weights beside it"):
        add_to_card(weights, DRIVING_SECTION, asdict(measured()))
    assert measured_likelihoods(weights) is None


@pytest.mark.parametrize(
    "damage",
    [
        {"success_if_reachable": 0.9},
        {"success_if_not": {"successes": 9, "trials": 2, "share": 0.5, "low": 0.0, "high": 1.0}},
        {"distance_sigma": -1.0},
    ],
)
def test_a_damaged_measurement_is_named(damage: dict[str, object]) -> None:
    section = json.loads(json.dumps(asdict(measured()))) | damage
    with pytest.raises(WeightsError, match="damaged"):
        read_driving({DRIVING_SECTION: section})


@pytest.mark.parametrize("name", ["robust", "paper"])
def test_the_method_takes_its_constants_from_the_shipped_card_as_far_as_they_were_measured(name: str) -> None:
    section = read_driving(read_card(SHIPPED_WEIGHTS))
    expected = {} if section is None else asdict(likelihoods(section))
    assert open_method(name, load_predictor()).believing == replace(preset(name).believing, **expected)


def test_the_method_takes_its_constants_from_a_card_of_its_weights(tmp_path: Path) -> None:
    weights = tmp_path / "own.safetensors"
    weights.write_bytes(b"weights")
    add_to_card(weights, DRIVING_SECTION, asdict(measured(there=18, not_there=2, sigma=0.1)))
    constants = measured_likelihoods(weights)
    assert constants is not None
    assert constants.p_success_if_reachable == pytest.approx(19 / 22)
    assert constants.p_success_if_not == pytest.approx(3 / 22)
    assert constants.sigma2 == pytest.approx(0.01)


def test_the_oracle_has_constants_of_its_own_and_explicit_ones_win() -> None:
    oracle = OraclePredictor(ClearanceMap(np.zeros((4, 4), bool), np.zeros(2)))
    assert open_method("robust", oracle).believing.p_success_if_not == oracle_predictor.LIKELIHOODS.p_success_if_not
    mine = Likelihoods(0.7, 0.3, 0.04)
    believing = open_method("robust", oracle, likelihoods=mine).believing
    assert (believing.p_success_if_reachable, believing.p_success_if_not, believing.sigma2) == (0.7, 0.3, 0.04)


def test_a_measurement_of_weights_that_are_not_there_is_not_written(tmp_path: Path) -> None:
    weights = tmp_path / "none.safetensors"
    with pytest.raises(WeightsError, match="there are no weights"):
        add_to_card(weights, DRIVING_SECTION, {})
    assert not card_path(weights).exists()
