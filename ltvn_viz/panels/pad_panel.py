"""The pad to drive by: tells the pages what the robot does by itself. The page's script draws it (`static/pad.js`)."""

import json
from collections.abc import Callable

from ltvn_viz.session.snapshot import Snapshot


class PadPanel:
    """Tells pages what is under way, and where the robot drives."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """Tell all pages by `tell`, which returns at once."""
        self._tell = tell
        self._told = ""

    def show(self, snapshot: Snapshot) -> None:
        """Tell it if it is something else."""
        message = _activity_message(snapshot)
        if message != self._told:
            self._told = message
            self._tell(message)


def _activity_message(snapshot: Snapshot) -> str:
    """Write what is under way, the node that the robot drives to, and whether a story goes on."""
    goal = None if snapshot.destination is None else int(snapshot.destination)
    return json.dumps({"type": "activity", "mode": snapshot.mode, "goal": goal, "story": snapshot.story_goes_on})
