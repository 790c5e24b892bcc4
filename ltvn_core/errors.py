"""The one family of errors a user can meet.

Every message says what was wrong, where, what would be valid, and what to do next. The command line prints the
message and exits non-zero; the page shows it as a notification. Programming mistakes stay ordinary exceptions.
"""


class LtvnError(Exception):
    """Base of all errors that a user can cause and correct."""


class ImageError(LtvnError):
    """An image or a depth map is not what the method can look at."""


class CameraError(LtvnError):
    """A camera's size, lens or mounting cannot be right."""


class RecordingError(LtvnError):
    """A recording is missing, foreign, cut, of another schema, or cannot be written."""


class DriveError(LtvnError):
    """A drive of another format is missing, foreign, cut, or lacks what a map needs."""


class MapError(LtvnError):
    """A map is empty, in pieces, or does not belong to the weights in use."""


class SceneError(LtvnError):
    """A scene is unknown or cannot be loaded."""


class WorldError(LtvnError):
    """A world cannot change in this way, or its script cannot be read."""


class DatasetError(LtvnError):
    """Training data are missing, cut, of another format, or cannot be written."""


class WeightsError(LtvnError):
    """Weights are missing, cut, or of another architecture."""


class OptionError(LtvnError):
    """An option of the command line or of the page has no such value."""


class EngineError(LtvnError):
    """A worker of a cluster is not like the machine that gives it work."""


class ServerError(LtvnError):
    """The page cannot be served, for instance because the port is taken."""


class PluginError(LtvnError):
    """A plug-in of another package cannot be used."""


class MissingLibraryError(LtvnError):
    """A library that only some jobs need is not installed; the message names the extra that installs it."""


class RobotError(LtvnError):
    """A robot cannot be reached, says what cannot be right, or is not described well enough to be driven."""
