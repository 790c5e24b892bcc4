"""All errors that a user can meet, in one family.

Every message says what was wrong, where, what would be valid, and what to do next. The command line prints the message
and exits with a non-zero code; the page shows it as a notification. Programming mistakes stay ordinary exceptions.
`remedy` says what to do where the operating system refuses something.
"""

import errno

_REMEDIES = {
    errno.ENOSPC: "free some space, or name another place (TMPDIR names the folder of temporary files)",
    errno.EDQUOT: "free some space, or name another place (TMPDIR names the folder of temporary files)",
    errno.EFBIG: "raise the limit of the size of files (ulimit -f), or name a place that takes large ones",
    errno.EROFS: "name a place that can be written to",
    errno.EACCES: "name a place that you may use, or change its permissions",
    errno.EPERM: "name a place that you may use, or change its permissions",
    errno.ENAMETOOLONG: "give it a shorter name",
    errno.EMFILE: "close other programs, or raise the limit of open files (ulimit -n)",
}
"""Advice for each error number of the operating system."""


def remedy(error: OSError) -> str:
    """Return what to do next after the operating system refused an operation."""
    return _REMEDIES.get(error.errno or 0, "check that it is there and that you may use it")


class LtvnError(Exception):
    """Base of all errors that a user can cause and correct."""


class ImageError(LtvnError):
    """An image or a depth map is not valid input for the method."""


class CameraError(LtvnError):
    """The size, lens or mounting of a camera is impossible."""


class RecordingError(LtvnError):
    """A recording is missing, foreign, truncated, of another schema, or cannot be written."""


class RecordingStoppedError(RecordingError):
    """The disk stopped accepting a recording, of which the beginning is in the file.

    `cause` and `remedy` say why and what to do without naming the file, which may be a temporary one.
    """

    def __init__(self, message: str, *, cause: str, remedy: str) -> None:
        """Take the whole message, and its parts."""
        super().__init__(message)
        self.cause = cause
        self.remedy = remedy


class DriveError(LtvnError):
    """A drive of another format is missing, foreign, truncated, or lacks what a map needs."""


class MapError(LtvnError):
    """A map is empty, in pieces, or does not belong to the weights in use."""


class SceneError(LtvnError):
    """A scene is unknown or cannot be loaded."""


class WorldError(LtvnError):
    """A world cannot change in this way, or its script cannot be read."""


class DatasetError(LtvnError):
    """Training data are missing, truncated, of another format, or cannot be written."""


class WeightsError(LtvnError):
    """Weights are missing, truncated, or of another architecture."""


class OptionError(LtvnError):
    """An option of the command line or of the page has an invalid value, or a request is not possible now."""


class EngineError(LtvnError):
    """A worker of a cluster differs from the machine that gives it work."""


class ServerError(LtvnError):
    """The page cannot be served, for instance because the port is taken."""


class PluginError(LtvnError):
    """A plug-in of another package cannot be used."""


class MissingLibraryError(LtvnError):
    """A library that only some jobs need is not installed; the message names the extra that installs it."""


class RobotError(LtvnError):
    """A robot cannot be reached, reports impossible values, or is not described well enough to be driven."""


class RobotPausedError(RobotError):
    """A robot was stopped because this program paused briefly; it obeys again once no commands come for a moment."""
