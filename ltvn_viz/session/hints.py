"""What to do next, in one sentence, for whoever sees the page for the first time."""

from ltvn_core.navigation.events import Outcome
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.snapshot import FineTuningPhase, Snapshot

FEW_NODES = 8
FEW_IMAGES = 5
"""Fewer than this, and nobody has driven yet."""


def hint(snapshot: Snapshot) -> str:
    """Return what a person could do next."""
    if not snapshot.timeline.is_now and not snapshot.timeline.is_replay:
        return "The scene shows the past, the camera what is now. “Live” below it returns, and so does driving."
    match snapshot.mode:
        case Mode.BUILDING:
            return "The map is being built from all images so far. You can cancel; the old map stays until then."
        case Mode.NAVIGATING:
            return "Watch: yellow is the plan. Take the robot over with W A S D, stop it with Space, or pause."
        case Mode.PAUSED:
            if snapshot.pause_notice:
                return f"{snapshot.pause_notice} Press Go on, or cancel."
            return "Paused. Resume, go on by single steps, or cancel."
        case Mode.REPLAY if snapshot.lone_camera is not None and not snapshot.moment.graph.ids.size:
            return "This is an imported drive. Play it, or press “Build the map anew” (B) under “Drive”."
        case Mode.REPLAY:
            return "This is a recording. Click into the timeline, or play; “Back to the robot” (Replay) ends it."
        case Mode.TELEOP:
            return _driving(snapshot)


def _driving(snapshot: Snapshot) -> str:
    moment = snapshot.moment
    if snapshot.is_open_loop:
        return "A recorded drive plays the robot. Watch the map grow, or ask under “Why” where the robot is."
    if snapshot.recording.name is not None:
        return "Recording. Drive through the rooms with W A S D; then keep the recording (N) or discard it."
    if snapshot.fine_tuning.phase is FineTuningPhase.LEARNED:
        return "The network has learned from your drive. Look at the figures under “Drive”, then use the new weights."
    if len(moment.graph.ids) < FEW_NODES and moment.frames < FEW_IMAGES:
        return "Hold W A S D or the arrow keys to drive. The map grows by itself as the robot sees new places."
    if len(moment.graph.ids) < FEW_NODES:
        return "The map is growing. Drive on through the doors; places seen from both sides connect best."
    ended = moment.progress.ended
    if ended is None:
        return "Pick a goal: click a node in the scene or an image under “Go”. Or hold W A S D and drive yourself."
    if ended.outcome is Outcome.ARRIVED:
        return "Arrived. Pick the next goal, or press R to record what happens from now on and replay it later."
    if ended.outcome is Outcome.CANCELLED:
        return "You have the robot. Hold W A S D to drive, or pick a goal again."
    return "It did not get there. Drive along the missing way so that the map learns it, then try the goal again."
