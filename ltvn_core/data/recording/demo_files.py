"""The demo map and the demo recording of the toolkit: inside the package in a wheel, else in the checkout.

Owns their location. Opens nothing.
"""

from pathlib import Path

DEMO_MAP = "demo-map.rrd"
"""Map of the demo apartment."""

DEMO_RECORDING = "demo-fault.rrd"
"""Four queries on that map after three faults were planted in it, to try the debugger on."""

_PLACES = (Path(__file__).parent / "demo", Path(__file__).parents[3] / "recordings")


def demo_file(name: str) -> Path | None:
    """Return the path of a demo file; None if it is missing."""
    return next((place / name for place in _PLACES if (place / name).is_file()), None)
