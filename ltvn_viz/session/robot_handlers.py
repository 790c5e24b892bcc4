"""Does the wishes about the robot's run: stop, cancel, pause and step it, record it, leave its replay.

The table of wishes names these functions. Run in the session's thread only.
"""

from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.navigation.events import Severity
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.wishes.modes import Mode


def stop(state: AppState) -> None:
    """Stop the robot and end whatever gives it its steps."""
    if state.open_loop:
        state.say(state.open_loop, Severity.WARN)
    _end_steps(state, "Stopped", "the robot was stopped")


def take_over(state: AppState) -> None:
    """End whatever gives the robot its steps, because a person drives."""
    _end_steps(state, "You took over", "somebody took over the robot")


def _end_steps(state: AppState, how: str, why: str) -> None:
    if ended := state.end_steps(why):
        state.say(f"{how}; {ended} was cancelled.")


def cancel(state: AppState) -> None:
    """Cancel the query or the building of a map; else the making of a recording, and the alignment of the plan."""
    if not isinstance(state.activity, Navigation | MapBuilding):
        state.making.cancel()
        if state.alignment is not None and state.alignment.is_on:
            state.alignment.toggle()
    state.cancel("Cancelled", "it was cancelled")


def pause(state: AppState) -> None:
    """Pause the query or the replay, or let it continue."""
    match state.activity:
        case Playback() as replay:
            replay.play(playing=not replay.playing)
        case Navigation() as navigation:
            navigation.resume() if navigation.mode is Mode.PAUSED else navigation.pause()
        case _:
            pass  # It is legal only in another mode, which was checked.


def step(state: AppState) -> None:
    """Let the query go on by one control step."""
    if isinstance(state.activity, Navigation):
        state.activity.step()


def keep_going(state: AppState, switch: int) -> None:
    """Let queries continue without a page, or pause. Raises OptionError for a real robot."""
    if switch and not state.live.robot.clock.is_simulated:
        raise OptionError(
            "Only a simulated robot may drive on with no page open; a real one needs a person who watches it."
        )
    state.keeps_going = bool(switch)


def play_drive(state: AppState) -> None:
    """Play the drive in the robot's place again. Raises OptionError if there is none."""
    if state.played is None:
        raise OptionError("There is no recorded drive in the robot's place to play again.")
    state.played.play()


def record(state: AppState) -> None:
    """Start a recording."""
    state.live.begin_recording()
    if state.world is not None:
        state.world.record()


def keep(state: AppState) -> None:
    """End the recording and keep it."""

    def kept(path: Path) -> None:
        state.last_recording = path.name
        state.say(f"Kept as {state.last_recording}. Open it under “Replay”.")

    state.live.recorder.keep(kept)


def discard(state: AppState) -> None:
    """End the recording and set it aside."""
    state.live.recorder.discard(
        lambda place: state.say(f"The recording was set aside as {place}; delete it there if you like.")
    )


def close_recording(state: AppState) -> None:
    """Return from the open recording to the robot."""
    state.activity = state.teleop
