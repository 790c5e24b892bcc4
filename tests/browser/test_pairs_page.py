"""Looking through labelled pairs, in a real headless Chromium."""

import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_core.errors import DatasetError
from ltvn_core.network.training_data.pose_sampling import ClusterSampling
from ltvn_core.network.training_data.shards import DatasetRecipe, make_shard, shard_path, write_shard
from ltvn_viz.pairs.pairs_app import PairsApp, PairsOptions, open_pairs_app
from tests.browser.pages import open_page
from tests.core.network.training_data.box_world import two_rooms

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PairsApp]:
    folder = tmp_path_factory.mktemp("data")
    recipe = DatasetRecipe(clusters=12, sampling=ClusterSampling(size=6))
    write_shard(make_shard(two_rooms("box"), recipe), shard_path(folder, "box"))
    with open_pairs_app(PairsOptions(folder, port=0)) as app:
        thread = threading.Thread(target=app.run, name="pairs")
        thread.start()
        yield app
        app.stop()
        thread.join(timeout=20)


@pytest.fixture
def page(app: PairsApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=900, height=700, draws=False) as page:
        page.locator(".lp-place").wait_for()
        yield page


def test_a_person_sees_a_pair_goes_on_and_asks_for_those_that_fail_a_criterion(page: Page) -> None:
    place, failed = page.locator(".lp-place"), page.locator(".lp-criterion")
    expect(place).to_contain_text("pair 1 of")
    expect(page.locator(".lt-table")).to_contain_text("overlap")
    picture = page.locator("img[src^='blob:']")
    picture.evaluate("image => image.decode()")  # Raises for an image that did not come.
    before = picture.get_attribute("src")

    page.get_by_role("button", name="Next").click()
    expect(place).to_contain_text("pair 2 of")
    expect(picture).not_to_have_attribute("src", before or "")

    page.get_by_label("Show", exact=True).click()
    page.get_by_role("option", name="fails: yaw").click()
    expect(page.locator(".lp-label")).to_have_text("not reachable")
    expect(place).to_contain_text("pair 1 of")
    expect(failed.filter(has_text="yaw")).to_be_visible()

    page.get_by_text("Network disagrees", exact=True).click()
    expect(page.get_by_text(re.compile("network disagrees|No pair passes"))).to_be_visible()


def test_the_page_of_pairs_has_no_pad_to_drive_with(page: Page) -> None:
    expect(page.locator(".ltvn-pad")).to_have_count(0)


def test_a_folder_without_shards_says_how_to_make_some(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="ltvn dataset"), open_pairs_app(PairsOptions(tmp_path, port=0)):
        pass
