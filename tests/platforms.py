"""Which tests need what only some systems have. Owns the reasons that are shown where they are skipped."""

import sys

import pytest

needs_posix = pytest.mark.skipif(
    sys.platform == "win32", reason="needs POSIX: signals, limits, pipes and links, or a shell that Windows lacks"
)

needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux: /proc, or /dev/full and mounts")
