"""Types of options that name what a verb writes, and the check before its work that all of them can be written."""

from enum import Enum, auto
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_args, get_type_hints

from ltvn_core.atomic_files import (
    MIN_FREE_DISK_BYTES,
    is_stream,
    require_new_path,
    require_usable_name,
    require_writable,
)
from ltvn_core.errors import OptionError


class Output(Enum):
    """What a verb writes under the path of an option."""

    NEW = auto()
    """A new file or folder."""
    RECORDING = auto()
    """A new recording or map."""
    TEXT = auto()
    """A new file of text, or a stream such as /dev/stdout."""
    WEIGHTS = auto()
    """Weights or a calibration, with a card beside it."""
    REPLACED = auto()
    """A file that replaces an older one."""
    SUMMARY = auto()
    """A summary as JSON, which may replace an older one; - and streams are possible too."""
    FOLDER = auto()
    """A folder with several files, some of which may be there already."""


NewOutput: TypeAlias = Annotated[Path, Output.NEW]
NewRecording: TypeAlias = Annotated[Path, Output.RECORDING]
NewText: TypeAlias = Annotated[Path, Output.TEXT]
NewWeights: TypeAlias = Annotated[Path, Output.WEIGHTS]
ReplacedFile: TypeAlias = Annotated[Path, Output.REPLACED]
SummaryFile: TypeAlias = Annotated[Path, Output.SUMMARY]
FilledFolder: TypeAlias = Annotated[Path, Output.FOLDER]


def outputs_of(options: object) -> list[tuple[Path, Output]]:
    """Return the paths that will be written with these options of a verb."""
    hints = get_type_hints(type(options), include_extras=True)
    named = [(getattr(options, name, None), _kind(hint)) for name, hint in hints.items()]
    return [(path, kind) for path, kind in named if kind is not None and isinstance(path, Path)]


def require_outputs(options: object) -> None:
    """Raise RecordingError or OptionError for an option under whose path nothing can be written."""
    for path, kind in outputs_of(options):
        match kind:
            case Output.NEW | Output.RECORDING:
                is_recording = kind is Output.RECORDING or path.suffix == ".rrd"
                require_new_path(path, free_bytes=MIN_FREE_DISK_BYTES if is_recording else 0)
            case Output.TEXT if not is_stream(path):
                require_new_path(path)
            case Output.WEIGHTS:
                require_writable(path)
                require_writable(path.with_suffix(".card.json"))
            case Output.REPLACED:
                require_writable(path)
            case Output.SUMMARY if str(path) != "-" and not is_stream(path):
                require_summary_file(path)
            case Output.FOLDER:
                require_usable_name(path)
                require_writable(path / "part")
            case _:
                pass


def _kind(hint: Any) -> Output | None:
    """Return the kind in a type such as `Annotated[Path, Output.NEW] | None`; None if the option is no output."""
    if isinstance(hint, Output):
        return hint
    return next((kind for part in get_args(hint) if (kind := _kind(part)) is not None), None)


def require_summary_file(path: Path) -> None:
    """Raise OptionError, RecordingError or OSError unless a summary can be written to a new file, or over an older one.

    No recording is ever lost by it, because only JSON and empty files are replaced.
    """
    require_usable_name(path)
    if not path.is_file():
        require_writable(path)
        return
    with path.open("r+b") as file:
        if file.read(1) not in (b"", b"{", b"["):
            raise OptionError(f"{path} exists and is no summary, so it is kept; name another file.")
