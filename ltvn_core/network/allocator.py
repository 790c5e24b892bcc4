"""Settings of glibc's malloc that keep freed memory in the process.

A step frees and allocates arrays of about ten megabytes again and again. By default glibc returns such blocks to the
system at once, and the kernel must clear every page of the next block, which takes a fifth of a training step or
search. Code that needed far more memory than usual returns it with `return_freed_memory`.
"""

import ctypes
import logging

log = logging.getLogger(__name__)

_TRIM_THRESHOLD = -1
_TOP_PAD = -2
_MMAP_THRESHOLD = -3
"""Names of glibc's mallopt(3)."""

_LARGEST_ON_HEAP = 32 * 2**20
"""Largest threshold that glibc accepts, in bytes; larger blocks are still returned to the system."""


def retain_freed_memory() -> bool:
    """Let the process keep freed memory; return whether the C library supports it (glibc does)."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        log.debug("The C library has no mallopt; it handles freed memory by its defaults.")
        return False
    settings = ((_MMAP_THRESHOLD, _LARGEST_ON_HEAP), (_TRIM_THRESHOLD, 2**31 - 1), (_TOP_PAD, 2**28))
    return all(mallopt(*setting) == 1 for setting in settings)


def return_freed_memory() -> None:
    """Return the memory that is free now to the system, after work that needed far more than usual."""
    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (OSError, AttributeError):
        log.debug("The C library has no malloc_trim; it returns freed memory by its defaults.")
