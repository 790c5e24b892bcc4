"""Messages to the user who started a run that can be watched in Rerun."""

import logging

from ltvn_core.data.recording.live_server import live_address
from ltvn_core.errors import OptionError

_LOG = logging.getLogger(__name__)
_LAST_PORT = 65535


def announce_stream(port: int | None) -> int | None:
    """Print the command to watch the recording at `port`, and return the port; None means no stream.

    Raises OptionError for an invalid port.
    """
    if port is None:
        return None
    if not 1 <= port <= _LAST_PORT:
        raise OptionError(f"--stream must be a port from 1 to {_LAST_PORT}, such as 9877, got {port}.")
    _LOG.info("Watch what is recorded: ltvn view %s (or: rerun %s)", live_address(port), live_address(port))
    return port
