"""`python -m figures` draws every picture from a tiny dataset, and the page's numbers are the card's."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from figures.__main__ import FiguresSummary, FiguresVerb
from figures.baseline_tables import baseline_blocks
from figures.metric_names import METRIC_NAMES
from figures.network_comparisons import comparison_tables
from figures.network_curves import error_band, reliability_bins
from figures.network_tables import network_blocks
from figures.pair_table import PairTable, limits_from_recipe, reasons, single_criteria, waypoint_outline
from ltvn_core.errors import OptionError, WeightsError
from ltvn_core.evaluation.reports.figure_style import MAX_BYTES
from ltvn_core.network.metrics import calibration_error
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.training_data.reachability_labels import FailedCriteria, ReachabilityLimits
from ltvn_core.network.weights_file import read_card
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.systems.registry import baseline_systems
from tests.core.network.tiny_data import tiny_shard
from tests.repository import ROOT
from tools.results_page import fill_blocks

PAGE = ROOT / "docs" / "network.md"


@pytest.mark.slow
def test_all_images_of_the_page_are_drawn_and_small(tmp_path: Path) -> None:
    pytest.importorskip("embreex")
    page = tmp_path / "network.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    made = FiguresVerb(
        data=tmp_path / "data", output=tmp_path / "images", page=page, scenes=("tune-3",), clusters=8, images=40
    ).run()
    assert isinstance(made, FiguresSummary)
    assert {path.name for path in made.pictures} == {
        Path(line.split("(")[1].rstrip(")")).name
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("![")
    }
    for path in made.pictures:
        assert path.stat().st_size <= MAX_BYTES
        picture = np.asarray(Image.open(path).convert("RGB"))
        assert min(picture.shape[:2]) > 400
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10
    assert "AUC" in page.read_text(encoding="utf-8")


def test_the_page_in_the_repository_is_filled_in_from_the_shipped_card(tmp_path: Path) -> None:
    page = tmp_path / "network.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    rivals = baseline_blocks({entry.name: read_card(entry.weights) for entry in baseline_systems()})
    fill_blocks(
        page,
        {**network_blocks(read_card(SHIPPED_WEIGHTS)), **rivals, **comparison_tables(PAGE.parent / "measurements")},
    )
    assert page.read_text(encoding="utf-8") == PAGE.read_text(encoding="utf-8"), (
        "run `python -m figures` after exchanging the weights"
    )


def test_rates_of_driving_and_times_are_shown_where_the_card_has_them() -> None:
    rate = {"successes": 9, "trials": 10, "share": 0.9, "low": 0.6, "high": 0.98}
    card = read_card(SHIPPED_WEIGHTS) | {
        "driving": {"success_if_reachable": rate, "scenes": ["a"]},
        "speed": {"pair_ms": 0.25},
    }
    text = network_blocks(card)["figures"]
    assert f"| {METRIC_NAMES['success_if_reachable']} | 0.900 (0.600 to 0.980, 10 trials) |" in text
    assert f"| {METRIC_NAMES['pair_ms']} | 0.250 |" in text


def test_filling_a_page_twice_changes_nothing_more(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- a: begin -->\nold\n<!-- a: end -->\nafter\n", encoding="utf-8")
    fill_blocks(page, {"a": "new"})
    once = page.read_text(encoding="utf-8")
    fill_blocks(page, {"a": "new"})
    assert page.read_text(encoding="utf-8") == once == "before\n<!-- a: begin -->\nnew\n<!-- a: end -->\nafter\n"


@pytest.mark.parametrize("text", ["", "<!-- a: end --><!-- a: begin -->", "<!-- a: begin -->"])
def test_a_page_without_the_comments_is_left_alone_and_named(tmp_path: Path, text: str) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(OptionError, match="a: begin"):
        fill_blocks(page, {"a": "new"})
    assert page.read_text(encoding="utf-8") == text


def test_a_missing_page_and_an_empty_card_are_clear_errors(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="page"):
        fill_blocks(tmp_path / "nowhere.md", {"a": "new"})
    with pytest.raises(WeightsError, match="ltvn train"):
        network_blocks({})


def test_the_reliability_diagram_shows_the_bins_of_the_calibration_error() -> None:
    rng = np.random.default_rng(0)
    said = rng.random(2000)
    true = rng.random(2000) < said**2
    bins = reliability_bins(said, true)
    assert bins.pairs.sum() == 2000
    gap = np.average(np.abs(bins.predicted - bins.true), weights=bins.pairs)
    assert gap == pytest.approx(calibration_error(said, true))


def test_a_band_holds_nine_tenths_of_the_errors_and_leaves_out_bins_of_few() -> None:
    at = np.concatenate([np.full(1000, 0.5), np.full(3, 1.5)])
    error = np.concatenate([np.linspace(0, 1, 1000), np.full(3, 9.0)])
    found = error_band(at, error, np.array([0.0, 1.0, 2.0]))
    assert found.middle.tolist() == [0.5]
    assert (found.low[0], found.median[0], found.high[0]) == pytest.approx((0.05, 0.5, 0.95))


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
