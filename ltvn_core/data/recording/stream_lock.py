"""The lock under which Rerun's streams are opened.

Rerun keeps all its streams in one table. Whoever opens one waits for the table with Python's GIL held, and whoever
cleans it up flushes every stream meanwhile, which needs the GIL to free NumPy memory. Two threads that did both at once
would wait for each other for ever.
"""

import os
import threading

STREAM_LOCK = threading.Lock()
"""Held while a stream of Rerun is opened, or the table of all streams is cleaned up."""

if hasattr(os, "register_at_fork"):  # Windows has no fork. A child must not inherit a lock that another thread held.
    os.register_at_fork(
        before=STREAM_LOCK.acquire, after_in_parent=STREAM_LOCK.release, after_in_child=STREAM_LOCK.release
    )
