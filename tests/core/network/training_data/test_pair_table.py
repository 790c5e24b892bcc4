"""Looking through labelled pairs: which are found, why they fail in words, and where a place appears in a picture."""

import numpy as np
import pytest

from ltvn_core.network.training_data.pair_table import (
    PairFilter,
    PairTable,
    limits_from_recipe,
    project,
    reasons,
    single_criteria,
    unproject,
    waypoint_outline,
)
from ltvn_core.network.training_data.reachability_labels import FailedCriteria, ReachabilityLimits
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.network.tiny_data import tiny_shard


def table() -> PairTable:
    return PairTable(tiny_shard())


def test_filters_by_label_and_distance_find_exactly_those_pairs() -> None:
    pairs = table()
    near = pairs.rows(PairFilter(reachable=True, min_distance_m=0.3, max_distance_m=1.2))
    assert len(near) > 0
    assert all(pairs.pair(row).reachable and 0.3 <= pairs.pair(row).distance_m <= 1.2 for row in near)
    kinds = [pairs.rows(PairFilter(reachable=kind)) for kind in (True, False)]
    assert sum(map(len, kinds)) == len(pairs)


@pytest.mark.parametrize("criterion", single_criteria())
def test_every_pair_that_fails_a_criterion_names_it_among_its_reasons(criterion: FailedCriteria) -> None:
    pairs = table()
    for row in pairs.rows(PairFilter(criterion=criterion)):
        pair = pairs.pair(row)
        found = reasons(pair, ReachabilityLimits())
        assert criterion in [each.criterion for each in found]
        assert len(found) == int(pair.failed).bit_count()
        assert all(each.text and each.name for each in found)


def test_pairs_in_which_network_and_label_disagree_are_found() -> None:
    pairs = table()
    said = pairs.shard.reachable.astype(float)
    said[3] = 1 - said[3]
    assert pairs.rows(PairFilter(only_disagreements=True), said).tolist() == [3]
    with pytest.raises(ValueError, match="reachability"):
        pairs.rows(PairFilter(only_disagreements=True))


def test_limits_are_those_of_the_shards_recipe() -> None:
    assert limits_from_recipe(tiny_shard().recipe) == ReachabilityLimits()
    assert limits_from_recipe('{"limits": {"overlap": 0.4, "unheard_of": 1}}') == ReachabilityLimits(overlap=0.4)
    assert limits_from_recipe("") == ReachabilityLimits()


def test_a_depth_pixel_is_projected_back_to_where_it_was() -> None:
    depth = np.zeros((72, 96), np.float32)
    depth[50, 20] = 1.7
    assert project(unproject(depth)) == pytest.approx(np.array([[20.5, 50.5]]), abs=1e-3)


def test_a_waypoint_ahead_stands_upright_in_the_image_and_one_behind_is_not_drawn() -> None:
    camera = LOCOBOT.camera
    mast = waypoint_outline(np.array([2.0, 0.0, 0.3])).mast
    assert mast[:, 0] == pytest.approx([camera.width / 2] * 2)
    assert mast[1, 1] == pytest.approx(camera.height / 2)
    assert mast[0, 1] > mast[1, 1]
    assert np.isnan(waypoint_outline(np.array([-1.0, 0.0, 0.0])).mast).all()
