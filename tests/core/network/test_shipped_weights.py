"""The shipped weights do in an unseen apartment what their card says, and the prefilter keeps what matters."""

from functools import lru_cache

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.geometry import distance
from ltvn_core.graph.builder import SECOND_PASS_REACHABILITY
from ltvn_core.network.pair_evaluation import LabelledDrive, evaluate_drives
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.weights_file import read_card, weights_fingerprint
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.held_out_scenes import TEST_SCENES, drives
from ltvn_core.types import Features, Prediction

pytest.importorskip("embreex")


@lru_cache
def drive() -> LabelledDrive:
    return drives(TEST_SCENES[:1], images=230)[0]


def test_the_card_belongs_to_the_weights_and_both_are_small() -> None:
    assert read_card(SHIPPED_WEIGHTS)["fingerprint"] == weights_fingerprint(SHIPPED_WEIGHTS)
    assert SHIPPED_WEIGHTS.stat().st_size < 20e6


@pytest.mark.slow
def test_far_pairs_are_rarely_called_reachable_where_most_near_ones_are() -> None:
    figures = evaluate_drives(load_predictor(), [drive()], np.random.default_rng(0), limit=3000)
    assert figures.far_fpr_at_tpr60 == 0
    assert figures.near_tpr_at_half >= 0.9


@lru_cache
def compared_in_full() -> tuple[Features, dict[int, Prediction]]:
    """Return the features of a drive, and what some of its images are answered about all."""
    predictor = load_predictor(prefilter_from=None)
    features = predictor.encode_images(drive().rgb, drive().depth_mm)
    sources = range(0, len(features), 23)
    return features, {source: predictor.predict(features[source : source + 1], features) for source in sources}


def test_screening_passes_nearly_all_pairs_that_could_become_edges_and_few_others() -> None:
    predictor, building = load_predictor(), ROBUST.building
    features, answers = compared_in_full()
    passed = [predictor.may_match(features[source : source + 1], features) for source in answers]
    connectable = [
        (found.reachability > SECOND_PASS_REACHABILITY) & (distance(found.waypoints) < building.connect_distance)
        for found in answers.values()
    ]
    assert np.mean(passed) < 0.5
    assert np.concatenate(passed)[np.concatenate(connectable)].mean() > 0.98


def test_the_prefilter_keeps_nearly_all_that_full_comparison_ranks_first() -> None:
    quick = load_predictor()
    features, answers = compared_in_full()
    kept = []
    for source, found in answers.items():
        everything = found.reachability
        filtered = quick.predict(features[source : source + 1], features).reachability
        first = np.argsort(-everything)[:6]
        assert filtered[first[:2]] == pytest.approx(everything[first[:2]], abs=1e-4)
        kept.extend(np.isclose(filtered[first], everything[first], atol=1e-4))
    assert np.mean(kept) > 0.9


@pytest.mark.parametrize("rival", ["sptm", "ving", "sorb", "htm"])
def test_a_baselines_card_belongs_to_its_weights_and_names_its_start(rival: str) -> None:
    weights = system_entry(rival).weights
    card = read_card(weights)
    assert card["fingerprint"] == weights_fingerprint(weights)
    assert card["parent"] == weights_fingerprint(SHIPPED_WEIGHTS)
    assert card["after"]["auc"] > card["before"]["auc"]
    assert not [name for name in card["trained_on"]["scenes"] if not name.startswith("train-")]
