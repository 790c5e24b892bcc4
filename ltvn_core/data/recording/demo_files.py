"""Paths of the toolkit's demo map and demo recording, in the installed package or in the checkout.

Opens no file.
"""

from pathlib import Path

DEMO_MAP = "demo-map.rrd"
"""Map of the demo apartment."""

DEMO_RECORDING = "demo-fault.rrd"
"""Four queries on the demo map after three faults were added to it, as an example for the debugger."""

_PLACES = (Path(__file__).parent / "demo", Path(__file__).parents[3] / "recordings")


def demo_file(name: str) -> Path | None:
    """Return the path of a demo file; None if it is missing."""
    return next((place / name for place in _PLACES if (place / name).is_file()), None)
