"""Text that every format can hold.

Names of files, arguments and JSON from outside may contain lone surrogates: bytes of a name that is not valid UTF-8, or
half of a surrogate pair. No text with them can be written as UTF-8, so they are replaced where such a text enters.
"""

import re

_LONE = re.compile("[\ud800-\udfff]")
_BYTES = range(0xDC80, 0xDD00)
"""Surrogates by which Python stands for the bytes of a name that is not valid UTF-8."""


def readable(text: str) -> str:
    r"""Return a text without lone surrogates: a byte of a name becomes \xe4, for instance, anything else U+FFFD.

    Different names stay different, so a file can be looked up by the result.
    """
    return text if text.isascii() else _LONE.sub(_stand_in, text)


def _stand_in(found: re.Match[str]) -> str:
    code = ord(found.group())
    return f"\\x{code - 0xDC00:02x}" if code in _BYTES else "\ufffd"
