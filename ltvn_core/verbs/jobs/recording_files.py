"""`ltvn info | verify | repair`: look after recordings."""

from ltvn_core.recording.damage.integrity import repair, verify
from ltvn_core.recording.info import read_info
from ltvn_core.verbs.recording_files import InfoVerb, RepairVerb, VerifyVerb
from ltvn_core.verbs.verb import Summary


def tell_info(options: InfoVerb) -> Summary:
    """Read the file's summary; raises RecordingError."""
    return read_info(options.recording)


def verify_recording(options: VerifyVerb) -> Summary:
    """Check the file; raises RecordingError that names `ltvn repair` for a cut or damaged one."""
    return verify(options.recording)


def repair_recording(options: RepairVerb) -> Summary:
    """Repair the file; raises RecordingError where nothing can be saved."""
    return repair(options.recording, options.output, recording_id=options.recording_id or None)
