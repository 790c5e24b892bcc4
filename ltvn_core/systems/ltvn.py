"""The registry entry of LTVN, the paper's own system, which is implemented in `ltvn_core.graph.ltvn`."""

from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.systems.entry import SystemEntry

LTVN = SystemEntry(name="ltvn", label="LTVN", factory=ltvn_system, preset_in_label=True)
