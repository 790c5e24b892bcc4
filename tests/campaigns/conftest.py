"""How campaigns are run: only when they are asked for, each with its share of the time, and with a table at the end."""

import os
import time

import pytest

from tests.campaigns.tally import Tally, table

MINUTES = float(os.environ.get("LTVN_CAMPAIGN_MINUTES", "15"))
"""For all campaigns together."""
PART = float(os.environ.get("LTVN_CAMPAIGN_PART", "1"))
"""Of the attempts that each asks for, to try a campaign out: 0.01 is one in a hundred."""
TALLIES = pytest.StashKey[list[Tally]]()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave campaigns out, unless `-m` names them."""
    campaigns = [item for item in items if item.get_closest_marker("campaign") is not None]
    if "campaign" in config.option.markexpr:
        for item in campaigns:  # A longer run is no test that hangs.
            item.add_marker(pytest.mark.timeout(60 * MINUTES + float(config.getini("timeout"))))
    elif campaigns:
        config.hook.pytest_deselected(items=campaigns)
        items[:] = [item for item in items if item not in campaigns]


@pytest.fixture
def tally(request: pytest.FixtureRequest) -> Tally:
    """The counts of this campaign, as its marker sizes it: `campaign(asked=..., share=...)`."""
    marker = request.node.get_closest_marker("campaign")
    asked, share = marker.kwargs["asked"], marker.kwargs["share"]
    name = request.node.name.removeprefix("test_").replace("_", " ")
    tally = Tally(name, max(1, round(PART * asked)), ends_s=time.monotonic() + 60 * MINUTES * share)
    request.config.stash.setdefault(TALLIES, []).append(tally)
    return tally


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print the counts."""
    if tallies := config.stash.get(TALLIES, []):
        terminalreporter.section("campaigns")
        terminalreporter.write_line(table(tallies))
