"""Labelled pairs for the figures: why they fail in words, and where a place appears in a picture."""

import numpy as np
import pytest

from figures.pair_table import PairTable, limits_from_recipe, reasons, single_criteria, waypoint_outline
from ltvn_core.network.training_data.reachability_labels import FailedCriteria, ReachabilityLimits
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.network.tiny_data import tiny_shard


@pytest.mark.parametrize("criterion", single_criteria())
def test_every_pair_that_fails_a_criterion_names_it_among_its_reasons(criterion: FailedCriteria) -> None:
    shard = tiny_shard()
    table = PairTable(shard)
    for row in np.flatnonzero(shard.failed & int(criterion)):
        pair = table.pair(int(row))
        found = reasons(pair, ReachabilityLimits())
        assert criterion in [each.criterion for each in found]
        assert len(found) == int(pair.failed).bit_count()
        assert all(each.text and each.name for each in found)


def test_limits_are_those_of_the_shards_recipe() -> None:
    assert limits_from_recipe(tiny_shard().recipe) == ReachabilityLimits()
    assert limits_from_recipe('{"limits": {"overlap": 0.4, "unheard_of": 1}}') == ReachabilityLimits(overlap=0.4)
    assert limits_from_recipe("") == ReachabilityLimits()


def test_a_waypoint_ahead_stands_upright_in_the_image_and_one_behind_is_not_drawn() -> None:
    camera = LOCOBOT.camera
    mast = waypoint_outline(np.array([2.0, 0.0, 0.3])).mast
    assert mast[:, 0] == pytest.approx([camera.width / 2] * 2)
    assert mast[1, 1] == pytest.approx(camera.height / 2)
    assert mast[0, 1] > mast[1, 1]
    assert np.isnan(waypoint_outline(np.array([-1.0, 0.0, 0.0])).mast).all()
