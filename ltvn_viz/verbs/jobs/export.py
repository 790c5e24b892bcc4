"""`ltvn export`: writes an excerpt of a recording, a test, a page or a figure, or converts all of it."""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.data.exporting.recording_export import ExportFormat, export_recording
from ltvn_core.data.recording.excerpt import Excerpt, time_span, write_excerpt
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary
from ltvn_viz.debugger.exports import draw_map, write_excerpt_test
from ltvn_viz.verbs.export import ExportVerb
from ltvn_viz.verbs.jobs.floor_plan import lay_floor_plan


@dataclass(frozen=True)
class ExportSummary:
    """Summary of an export."""

    recording: Path
    """The exported recording."""
    output: Path | None
    """New recording with the excerpt."""
    frames: int | None
    """Number of frames in the new recording."""
    events: int | None
    size_bytes: int | None
    test: Path | None
    """A pytest file about the excerpt, to be edited by hand."""
    html: Path | None
    svg: Path | None
    format: str | None
    """Format given by --to; None for a recording."""
    nodes: int | None
    """Number of nodes of a map in another format."""
    edges: int | None


def export(options: ExportVerb) -> Summary:
    """Write the requested files; raises OptionError, RecordingError, MapError and SceneError."""
    to_s, to_format = _end(options)
    _check(options, to_format)
    if to_format is not None:
        return _export(options, to_format, to_s)
    excerpt = _cut(options, to_s) if options.output is not None else None
    if options.html is not None or options.svg is not None:
        _draw(options, to_s)
    return _summary(
        options,
        frames=None if excerpt is None else excerpt.frames,
        events=None if excerpt is None else excerpt.events,
        size_bytes=None if excerpt is None else excerpt.size_bytes,
    )


def _end(options: ExportVerb) -> tuple[float | None, ExportFormat | None]:
    """Return the end of the excerpt, and the other format; --to gives only one of them."""
    if options.to is None:
        return options.until, None
    if options.to in (names := [each.value for each in ExportFormat]):
        return options.until, ExportFormat(options.to)
    try:
        seconds = float(options.to)
    except ValueError as error:
        raise OptionError(f"--to takes a format ({', '.join(names)}) or seconds, got {options.to!r:.40}.") from error
    if options.until is not None:
        raise OptionError("--to already gives seconds; use --until only with --to FORMAT.")
    return seconds, None


def _check(options: ExportVerb, to_format: ExportFormat | None) -> None:
    if to_format is not None:
        _check_format(options, to_format)
    elif (options.floor_plan or options.align) and not (options.html or options.svg):
        raise OptionError("--floor-plan needs a map; use it with --html, --svg or a format of maps.")
    elif options.output is None and options.html is None and options.svg is None:
        raise OptionError("Nothing to write: give --output for a recording, or --html or --svg for the map.")
    if options.test is not None and options.output is None:
        raise OptionError("--test needs --output, the recording that the test opens.")


def _check_format(options: ExportVerb, to_format: ExportFormat) -> None:
    name = to_format.value
    if options.output is None:
        raise OptionError(f"--to {name} needs --output, the file or folder to write.")
    if options.html or options.svg or options.test or options.named_only:
        raise OptionError(f"--to {name} writes only one output; omit --html, --svg, --test and --named-only.")
    if not to_format.is_map and (options.floor_plan or options.align):
        raise OptionError(f"--to {name} writes a drive; use --floor-plan only with graphml, geojson and nav2-route.")
    if to_format.is_map and (options.from_s is not None or options.until is not None):
        raise OptionError(f"--to {name} writes the map at the end; use --from and --until only for drives.")
    if options.output.suffix == ".rrd":
        raise OptionError(f"--to {name} does not write a recording; --output must not end in .rrd.")


def _export(options: ExportVerb, to_format: ExportFormat, to_s: float | None) -> Summary:
    recording = Recording.open(options.recording, whole=True)
    output = options.output or Path()
    laid = lay_floor_plan(options, options.recording)
    frame = None if laid is None else laid.frame
    done = export_recording(recording, output, to_format, from_s=options.from_s, to_s=to_s, frame=frame)
    files = [output] if output.is_file() else [file for file in output.rglob("*") if file.is_file()]
    return _summary(
        options,
        frames=done.frames,
        size_bytes=sum(file.stat().st_size for file in files),
        nodes=done.nodes,
        edges=done.edges,
        to_format=to_format.value,
    )


def _summary(
    options: ExportVerb,
    *,
    frames: int | None = None,
    events: int | None = None,
    size_bytes: int | None = None,
    nodes: int | None = None,
    edges: int | None = None,
    to_format: str | None = None,
) -> ExportSummary:
    return ExportSummary(
        recording=options.recording,
        output=options.output,
        frames=frames,
        events=events,
        size_bytes=size_bytes,
        test=options.test,
        html=options.html,
        svg=options.svg,
        format=to_format,
        nodes=nodes,
        edges=edges,
    )


def _cut(options: ExportVerb, until_s: float | None) -> Excerpt:
    recording = Recording.open(options.recording, whole=True)
    begin, end = time_span(recording)
    from_s = begin if options.from_s is None else options.from_s
    to_s = end if until_s is None else until_s
    output = options.output or Path()
    written = write_excerpt(recording, output, from_s=from_s, to_s=to_s, named_only=options.named_only)
    if options.test is not None:
        write_excerpt_test(recording, output, options.test, from_s=from_s, to_s=to_s)
    return written


def _draw(options: ExportVerb, to_s: float | None) -> None:
    laid = lay_floor_plan(options, options.recording)
    plan = None if laid is None else laid.plan
    draw_map(Recording.open(options.recording, whole=True), to_s, html=options.html, svg=options.svg, floor_plan=plan)
