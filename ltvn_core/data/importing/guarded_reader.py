"""A drive that a reader of another package opened: what it lacks, and what it does wrongly, names the package."""

from collections.abc import Iterator, Mapping, Sequence

from ltvn_core.data.importing.raw_frame import DriveFacts, DriveReader, FrameFilter, RawFrame, SelectiveReader
from ltvn_core.plugins import Plugin


def guarded_reader(plugin: Plugin, opened: DriveReader) -> DriveReader:
    """Return a drive that another package opened, checked. Raises PluginError, which names a part that it lacks."""
    with plugin.running("cannot be used"):
        facts: object = opened.facts
        if not isinstance(facts, DriveFacts):
            raise plugin.refusal(f"opens a drive whose `facts` are {facts!r:.60}, not a DriveFacts")
        if not (
            isinstance(opened.dropped, Mapping) and isinstance(opened.doubts, Sequence) and callable(opened.frames)
        ):
            raise plugin.refusal("opens a drive whose `dropped`, `doubts` or `frames` is not as DriveReader says")
        return (GuardedSelectiveReader if isinstance(opened, SelectiveReader) else GuardedReader)(plugin, opened)


class GuardedReader:
    """Passes everything on to the reader of another package. Implements `DriveReader`."""

    def __init__(self, plugin: Plugin, reader: DriveReader) -> None:
        """Read from `reader`, which `plugin` opened."""
        self._plugin = plugin
        self._reader = reader

    @property
    def facts(self) -> DriveFacts:
        """Return the reader's facts."""
        return self._reader.facts

    @property
    def dropped(self) -> Mapping[str, int]:
        """Return the number of images that the reader left out, by reason."""
        return self._reader.dropped

    @property
    def doubts(self) -> Sequence[str]:
        """Return the reader's doubts."""
        return self._reader.doubts

    def frames(self) -> Iterator[RawFrame]:
        """Yield the reader's frames. Raises PluginError for whatever it raises, and for what is no frame."""
        with self._plugin.running("could not read the drive"):
            yield from map(self._frame, self._reader.frames())

    def _frame(self, frame: object) -> RawFrame:
        if not isinstance(frame, RawFrame):
            raise self._plugin.refusal(f"yields {type(frame).__name__}, not a RawFrame")
        return frame


class GuardedSelectiveReader(GuardedReader):
    """The same for a reader that decodes only some images. Implements `SelectiveReader` too."""

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the reader's frames of the wanted moments, as `frames` does."""
        assert isinstance(self._reader, SelectiveReader)
        with self._plugin.running("could not read the drive"):
            yield from map(self._frame, self._reader.frames_where(wanted))
