"""A recording that can be watched while it is written: a Rerun server on 127.0.0.1 beside the file.

Owns the port and the address. What is streamed is what goes into the file, and the file never waits for a viewer.
"""

import re
import socket

import rerun as rr

from ltvn_core.errors import ServerError

_MEMORY = "256MiB"
"""So much is kept for viewers that come late."""
_ADDRESS = re.compile(r"rerun\+http://127\.0\.0\.1:(?P<port>[1-9][0-9]{0,4})/proxy", re.ASCII)


def live_address(port: int) -> str:
    """Return what a Rerun viewer opens to watch, for `rerun ADDRESS` and `ltvn view ADDRESS`."""
    return f"rerun+http://127.0.0.1:{port}/proxy"


def port_of(address: str) -> int | None:
    """Return the port of a live recording's address, None for anything else."""
    found = _ADDRESS.fullmatch(address)
    return None if found is None else int(found["port"])


def live_sink(port: int) -> rr.GrpcServerSink:
    """Return a sink that viewers of this machine can connect to. Raises ServerError when the port is taken.

    Rerun itself would only log that it cannot listen.
    """
    try:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
    except (OSError, OverflowError) as error:
        raise ServerError(
            f"Port {port} on 127.0.0.1 cannot be used for streaming ({error}); name another with --stream. Rerun's own "
            "program listens on 9876."
        ) from error
    return rr.GrpcServerSink(bind_ip="127.0.0.1", port=port, server_memory_limit=_MEMORY)
