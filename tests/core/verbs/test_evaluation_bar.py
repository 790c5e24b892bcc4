"""The bar of an evaluation names the maps that are ready, and counts the work of the whole share."""

import io

from tqdm import tqdm

from ltvn_core.evaluation.runner import Progress
from ltvn_core.verbs.evaluate import shown_on


def test_the_bar_shows_the_maps_and_the_work_with_its_total() -> None:
    shown = io.StringIO()
    with tqdm(desc="evaluate", unit="episode", file=shown, mininterval=0) as bar:
        tell = shown_on(bar)
        tell(Progress(drives=2, weights=1, maps=0, all_maps=2, rows=10, all_rows=50))
        assert (bar.n, bar.initial, bar.total) == (10, 10, 50)
        assert bar.last_print_n == 10, "what was finished before is no speed"
        assert "0 maps of 2" in shown.getvalue()
        tell(Progress(drives=2, weights=2, maps=2, all_maps=2, rows=35, all_rows=50))
        assert bar.n == 35
        assert not bar.postfix
