"""Runs the commands about goals: navigation to a node, or to the place of a picture.

A goal that the map may not hold is reported before the robot drives. Runs in the session's thread only.
"""

from collections.abc import Sequence

from ltvn_core.analysis.image_similarity import LIKELY_HELD
from ltvn_core.errors import LtvnError, OptionError, SceneError
from ltvn_core.maps.map_coverage import GoalReport
from ltvn_core.navigation.events import Severity
from ltvn_core.types import FrameId, NodeId, Rgb
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.goals import SIMILAR_NODE_COUNT, FoundPlace, picture_address
from ltvn_viz.session.snapshot import JobProgress, LikePlace, UploadMatch
from ltvn_viz.timeline.run_moment import moment_of

NOT_FOUND = "Image not found in the map"
"""Title of the message for a picture that was not found."""


def pick(state: AppState, node: NodeId) -> None:
    """Handle a click on a node: use it for the floor plan's alignment, for the debugger's question, or as the goal."""
    if state.alignment is not None and state.alignment.is_on:
        state.alignment.take_node(node, moment_of(state.shown_run).graph)
    elif state.debugger.is_on:
        state.debugger.point_at(node)
    elif not isinstance(state.activity, Playback):
        choose_goal(state, node)


def choose_goal(state: AppState, node: NodeId) -> None:
    """Navigate to a node; while a query runs, choose the node as the next goal."""
    if state.activity is state.teleop:
        navigate(state, node)
    else:
        state.goals.selected = node


def navigate(state: AppState, node: NodeId | None) -> None:
    """Drive to a node, or to the chosen goal, in place of a story.

    Raises OptionError without a goal, or if the robot cannot drive.
    """
    if state.open_loop:
        raise OptionError(state.open_loop)
    goal = state.goals.selected if node is None else node
    if goal is None:
        raise OptionError("Choose a goal first: click a node of the map or an image under “Go”.")
    if goal not in state.live_map.graph.nodes:
        count = len(state.live_map.graph.nodes)
        raise OptionError(f"Node {goal} is not in the map, which has {count:,} nodes; the robot stays. Choose another.")
    state.end_steps("the robot has another goal")
    drive_to(state, goal)


def drive_to(state: AppState, goal: NodeId) -> None:
    """Drive to a node on behalf of a person or of the story."""
    state.live.robot.stop()
    state.actions.forget()
    state.goals.selected = goal
    _tell_goal(state, goal)
    state.queries += 1
    query = state.live_map.query(state.live.robot, goal, state.queries, state.actions)
    state.activity = Navigation(
        state.live,
        state.worker,
        goal,
        query,
        cancel=state.live_map.cancel,
        prepare=lambda: state.actions.settle(lambda node: _put_at(state, node)),
    )


def _put_at(state: AppState, node: NodeId) -> None:
    """Put a simulated robot at a node, because it cannot take a lift; a real robot was put there by the person.

    If the node is not in this scene, the robot stays where it is.
    """
    pose = state.live_map.keyframes.observation(node).exact_pose
    if state.world is None or pose is None:
        return
    try:
        state.world.carry(pose)
    except SceneError as error:
        state.say(
            f"The simulated robot stays where it is, because it cannot stand at node {node}: {error}", Severity.WARN
        )


def _tell_goal(state: AppState, goal: NodeId) -> None:
    """Report a goal that the map may not hold, before the robot drives; the worker runs the query after this."""

    def tell(report: GoalReport) -> None:
        if report.finding is not None:
            state.say(str(report.finding), report.finding.severity)

    state.worker.submit(lambda: state.live_map.goal_report(goal), tell)


def find_and_go(state: AppState, rgb: Rgb, original: Rgb | None) -> None:
    """Navigate to the node most similar to a picture (H, W, 3), if one is surely similar; show `original` beside it."""

    def find() -> tuple[UploadMatch, Sequence[tuple[FrameId, Rgb]]]:
        places = [LikePlace(*place) for place in state.live_map.similar_nodes(rgb, SIMILAR_NODE_COUNT)]
        nodes = [place.node for place in places]
        shown = rgb if original is None else original
        return UploadMatch(picture_address(shown), tuple(places)), state.live_map.node_images(nodes)

    search = object()

    def go(found: tuple[UploadMatch, Sequence[tuple[FrameId, Rgb]]]) -> None:
        state.goals.offer_match(*found)
        best = found[0].places[0]
        if state.search is not search:
            return  # It was stopped meanwhile, or something newer drives the robot.
        state.search = None
        if best.likeness < LIKELY_HELD:
            state.goals.selected = None
            state.say(_hardly_held(best), Severity.WARN, title=NOT_FOUND)
            return
        state.say(
            "Going to the place that looks most like your image. Others that look like it stand beside it, under “Go”."
        )
        navigate(state, best.node)

    state.end_steps("the robot has another goal")
    state.search = search
    state.worker.submit(find, go, otherwise=lambda: _forget(state, search))


def _forget(state: AppState, search: object) -> None:
    if state.search is search:
        state.search = None


def _hardly_held(best: LikePlace) -> str:
    return (
        f"The map may not hold your image: node {best.node} looks most like it, with a likeness of "
        f"{best.likeness:.2f}, where 1 is the same image and other places hardly reach {LIKELY_HELD:g}. The robot "
        "stays. If one of the places beside your image is right, click it."
    )


def find_place(state: AppState, replay: Playback, rgb: Rgb) -> None:
    """Report the place in the map of a replay where a picture (H, W, 3) was taken."""
    path = state.library.path(replay.name)
    predictor = state.live_map.predictor

    def find() -> FoundPlace | str:
        try:
            return state.places.find(path, rgb, predictor)
        except LtvnError as error:
            return str(error)

    def show(found: FoundPlace | str) -> None:
        state.work = None
        if isinstance(found, str):
            state.say(found, Severity.ERROR)
            return
        replay.found = found.node
        if found.node is not None:
            state.say(found.text)
        else:
            state.say(found.text, Severity.WARN, title=NOT_FOUND)

    state.work = JobProgress("Looking for the image in this map")
    state.worker.submit(find, show)
