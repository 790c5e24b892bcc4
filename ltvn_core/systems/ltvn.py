"""The registry entry of LTVN, the paper's own system. `ltvn_core.graph.ltvn` implements the system."""

from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.systems.entry import SystemEntry

LTVN = SystemEntry(name="ltvn", label="LTVN", factory=ltvn_system, preset_in_label=True)
