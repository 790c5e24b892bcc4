"""Where the tests find what the repository ships beside the code."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
RECORDINGS = ROOT / "recordings"
DEMO_MAP = RECORDINGS / "demo-map.rrd"
DEMO_DRIVE = RECORDINGS / "demo-drive.rrd"
DEMO_FAULT = RECORDINGS / "demo-fault.rrd"
"""A recording with planted faults."""
GOLDEN_RECORDING = ROOT / "tests" / "data" / "golden-schema-1.rrd"
"""The example recording as the first version wrote it."""
