"""Types of options that several verbs use: installed systems and predictors by name, and the port of a stream."""

import logging
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import tyro

from ltvn_core.errors import OptionError
from ltvn_core.plugins import PREDICTORS, find_plugins
from ltvn_core.systems.registry import system_names

_LOG = logging.getLogger(__name__)
LAST_PORT = 65535

AUTO = "auto"
"""Same value as in `ltvn_core.predictors.choice`, which would import numpy for every `--help`."""

if TYPE_CHECKING:
    SystemName: TypeAlias = str
    PredictorName: TypeAlias = str
else:
    SystemName = Literal[system_names()]
    PredictorName = Literal[(AUTO, *find_plugins(PREDICTORS, first=("network", "geometric", "oracle")))]

DeviceOption: TypeAlias = Annotated[
    Literal["auto", "cpu", "cuda", "mps"],
    tyro.conf.arg(help="Where the network computes; auto takes a card with CUDA if PyTorch finds one, else the CPU."),
]
"""A verb gives it the default "auto"."""


def announce_stream(port: int | None) -> int | None:
    """Print the command to watch the recording at `port`, and return the port; None means no stream.

    Raises OptionError for an invalid port.
    """
    if port is None:
        return None
    if not 1 <= port <= LAST_PORT:
        raise OptionError(f"--stream must be a port from 1 to {LAST_PORT}, such as 9877, got {port}.")
    from ltvn_core.data.recording.live_server import live_address

    _LOG.info("Watch what is recorded: ltvn view %s (or: rerun %s)", live_address(port), live_address(port))
    return port
