"""The bar of an evaluation moves while maps are prepared, and counts the work afterwards."""

import io

from tqdm import tqdm

from ltvn_core.verbs.evaluate import progress_on_bar


def test_the_bar_shows_the_preparation_and_then_the_work() -> None:
    shown = io.StringIO()
    with tqdm(total=50, desc="evaluate", unit="episode", file=shown, mininterval=0) as bar:
        progress = progress_on_bar(bar, 2)
        progress.preparing(0.25)
        assert (bar.n, bar.total, bar.desc) == (25, 100, "prepare maps")
        progress.maps_ready(1)
        progress.preparing(0.75)
        assert bar.n == 75
        progress.maps_ready(2)
        progress.preparing(0.99)  # The thread that tells may be a moment late.
        assert (bar.n, bar.total, bar.desc, bar.unit) == (0, 50, "evaluate", "episode")
        progress.unfinished(7)
        progress.work_done(25)
        assert bar.n == 25
    assert "7 more in unfinished batches" in shown.getvalue()
