"""Two depth images of one wall agree under the true motion and contradict each other under a false one."""

import pytest
import torch

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.pair_head import GeometricVerification, PlanarMotion

WALL_M = 3.0
AHEAD_M = 1.0


@pytest.fixture
def verification() -> GeometricVerification:
    return GeometricVerification(PairArchitecture())


def motion(*ahead_m: float) -> PlanarMotion:
    shift = torch.tensor([[metres, 0.0] for metres in ahead_m])
    return PlanarMotion(shift, torch.tensor([[1.0, 0.0]] * len(ahead_m)))


def wall(verification: GeometricVerification, *away_m: float) -> torch.Tensor:
    return torch.tensor(away_m)[:, None].expand(-1, verification.rows * verification.columns)


def test_a_wall_fits_under_the_true_motion_alone(verification: GeometricVerification) -> None:
    before, after = wall(verification, WALL_M, WALL_M), wall(verification, WALL_M - AHEAD_M, WALL_M - AHEAD_M)
    true, false = verification(before, after, motion(AHEAD_M, -AHEAD_M))
    assert true[0] > 0.95
    assert true[[1, 2]].sum() == 0
    assert false[0] == 0


def test_both_images_are_measured_by_the_same_rule(verification: GeometricVerification) -> None:
    here, there = wall(verification, 3.0, 2.5, 1.5), wall(verification, 2.0, 2.5, 0.0)
    way = motion(1.0, 0.3, -0.5)
    forth, back = verification(here, there, way), verification(there, here, way.inverse())
    assert torch.equal(forth[:, :4], back[:, 4:8])
    assert torch.equal(forth[:, 4:8], back[:, :4])


def test_the_measures_of_a_pair_do_not_depend_on_the_other_pairs(verification: GeometricVerification) -> None:
    here, there, way = wall(verification, 3.0, 2.0), wall(verification, 2.0, 4.0), motion(1.0, 0.5)
    alone = verification(here[:1], there[:1], PlanarMotion(way.shift[:1], way.turn[:1]))
    assert torch.equal(verification(here, there, way)[:1], alone)
