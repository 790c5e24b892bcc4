"""Each wish asked over a real drive socket: it is fulfilled where it makes sense; elsewhere one hears why not."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import pytest

from ltvn_core.navigation.action_performer import ActionState
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import FineTuningPhase, Snapshot
from ltvn_viz.wishes.commands import Action, Value
from ltvn_viz.wishes.modes import ANYWHERE, Mode
from ltvn_viz.wishes.wish import fits
from tests.browser.flat_app import FlatApp, serving, until_shown
from tests.core.data.importing.plan_files import laid_room
from tests.viz.page_sockets import PageSockets, open_live_page
from tests.viz.two_floors import add_lift, split_rooms
from tests.waiting import until


@dataclass(frozen=True)
class Asking:
    """A page that drives, and the app that it asks."""

    app: FlatApp
    page: PageSockets

    @property
    def now(self) -> Snapshot:
        return self.app.harness.now

    @property
    def far(self) -> int:
        """A node that is some way off."""
        return int(self.now.moment.graph.ids[-1])

    def until(self, holds: Callable[[Snapshot], object]) -> Snapshot:
        return until_shown(self.app, lambda now: bool(holds(now)))

    def ask(self, action: Action, value: Value, holds: Callable[[Snapshot], object]) -> Snapshot:
        self.page.ask(action, value)
        return self.until(holds)

    def hears(self, action: Action, value: Value, *words: str) -> None:
        """Ask, and wait for a new message with all these words in it."""
        before = 0 if self.now.message is None else self.now.message.number
        self.ask(
            action,
            value,
            lambda now: now.message and now.message.number > before and all(word in now.message.text for word in words),
        )

    def enter(self, mode: Mode) -> None:
        """Bring the app from driving into a mode, in which it stays."""
        match mode:
            case Mode.TELEOP:
                pass
            case Mode.NAVIGATING | Mode.PAUSED:
                self.ask(Action.GOAL, self.far, lambda now: now.mode is Mode.NAVIGATING)
                if mode is Mode.PAUSED:
                    self.ask(Action.PAUSE, None, lambda now: now.mode is Mode.PAUSED)
            case Mode.BUILDING:
                self.ask(Action.BUILD, None, lambda now: now.mode is Mode.BUILDING)
            case Mode.REPLAY:
                self.ask(Action.OPEN, self.record(), lambda now: now.mode is Mode.REPLAY)

    def record(self) -> str:
        """Keep a short recording and return its name."""
        self.ask(Action.RECORD, None, lambda now: now.recording.name)
        self.ask(Action.KEEP, None, lambda now: now.recording.name is None and now.recordings)
        return next(iter(self.now.recordings))


@pytest.fixture
def asking(tmp_path: Path) -> Iterator[Asking]:
    with serving(tmp_path) as app:
        until_shown(app, lambda now: bool(now.gallery))
        with open_live_page(app.server) as page:
            page.take_seat()
            yield Asking(app, page)


@pytest.fixture
def keep_busy(asking: Asking) -> Iterator[Callable[[], None]]:
    """Keeps the app's thread for long jobs busy from the call on, so that they stay under way."""
    free = Event()
    yield lambda: asking.app.harness.state.worker._executor.submit(free.wait) and None
    free.set()


TRIALS: dict[Action, Callable[[Asking], None]] = {}


def fulfils(*actions: Action) -> Callable[[Callable[[Asking], None]], Callable[[Asking], None]]:
    """Note which wishes a trial sees fulfilled."""

    def note(trial: Callable[[Asking], None]) -> Callable[[Asking], None]:
        TRIALS.update(dict.fromkeys(actions, trial))
        return trial

    return note


def looks_back(now: Snapshot) -> bool:
    return not now.timeline.is_now


@fulfils(Action.RELEASE, Action.TAKE_OVER)
def tries_seat(asking: Asking) -> None:
    seat, page = asking.app.server.seat, asking.page
    page.ask(Action.RELEASE)
    until(lambda: seat.state_of(page.number).driver is None)
    page.ask(Action.TAKE_OVER)
    until(lambda: seat.state_of(page.number).driver == page.number)


@fulfils(Action.STOP, Action.GOAL)
def tries_stop(asking: Asking) -> None:
    asking.enter(Mode.NAVIGATING)
    asking.ask(Action.STOP, None, lambda now: now.mode is Mode.TELEOP)


@fulfils(Action.RECORD, Action.DISCARD)
def tries_discarding(asking: Asking) -> None:
    asking.ask(Action.RECORD, None, lambda now: now.recording.name)
    asking.hears(Action.DISCARD, None, "set aside")


@fulfils(Action.KEEP, Action.OPEN, Action.CLOSE)
def tries_recording(asking: Asking) -> None:
    name = asking.record()
    assert name in asking.ask(Action.OPEN, name, lambda now: now.replay).recordings
    asking.ask(Action.CLOSE, None, lambda now: now.mode is Mode.TELEOP)


@fulfils(Action.BUILD, Action.UNDO_BUILD)
def tries_building(asking: Asking) -> None:
    asking.hears(Action.BUILD, None, "rebuilt")
    asking.until(lambda now: now.can_undo_build)
    asking.hears(Action.UNDO_BUILD, None, "old map")


@fulfils(Action.LEARN, Action.STOP_LEARNING, Action.USE_WEIGHTS, Action.LEAVE_WEIGHTS)
def tries_learning(asking: Asking) -> None:
    for minutes in (0, 61):
        asking.hears(Action.LEARN, minutes, "1 to 60 minutes")
    asking.hears(Action.USE_WEIGHTS, None, "weights")
    asking.ask(Action.LEARN, 1, lambda now: now.fine_tuning.phase is not FineTuningPhase.IDLE)
    asking.page.ask(Action.STOP_LEARNING)
    asking.until(lambda now: now.fine_tuning.phase is not FineTuningPhase.LEARNING)
    asking.ask(Action.LEAVE_WEIGHTS, None, lambda now: now.fine_tuning.phase is FineTuningPhase.IDLE)


@fulfils(Action.PAUSE, Action.STEP, Action.CANCEL, Action.QUERY_BEFORE, Action.QUERY_AFTER)
def tries_query(asking: Asking) -> None:
    asking.enter(Mode.PAUSED)
    asking.ask(Action.PAUSE, None, lambda now: now.mode is Mode.NAVIGATING)
    asking.ask(Action.STEP, None, lambda now: now.mode is Mode.PAUSED)
    asking.ask(Action.CANCEL, None, lambda now: now.mode is Mode.TELEOP)
    asking.ask(Action.QUERY_BEFORE, None, looks_back)
    asking.ask(Action.QUERY_AFTER, None, lambda now: not looks_back(now))


@fulfils(Action.END_ACTION)
def tries_an_action(asking: Asking) -> None:
    harness = asking.app.harness
    asking.app.session.send(split_rooms(harness))
    asking.app.session.send(add_lift(harness))
    asking.enter(Mode.NAVIGATING)
    asking.until(lambda now: now.waiting and harness.state.actions.state() is ActionState.PENDING)
    asking.ask(Action.END_ACTION, 0, lambda now: not now.waiting)


@fulfils(Action.SHOW_FLOOR)
def tries_floors(asking: Asking) -> None:
    asking.app.session.send(split_rooms(asking.app.harness))
    asking.app.session.send(add_lift(asking.app.harness))
    asking.until(lambda now: now.floor)
    asking.ask(Action.SHOW_FLOOR, 1, lambda now: now.floor and now.floor.floor == 1)
    asking.ask(Action.SHOW_FLOOR, None, lambda now: now.floor and now.floor.follows_robot)


@fulfils(Action.SELECT, Action.PICK)
def tries_goals(asking: Asking) -> None:
    for action in (Action.SELECT, Action.PICK):
        asking.ask(action, asking.far, lambda now: now.mode is Mode.NAVIGATING and now.selected == asking.far)
        asking.ask(Action.CANCEL, None, lambda now: now.mode is Mode.TELEOP)


@fulfils(Action.HELP)
def tries_help(asking: Asking) -> None:
    """The page shows its help by itself; the app takes it for nothing."""
    asking.page.ask(Action.HELP)
    asking.enter(Mode.NAVIGATING)


@fulfils(Action.KEEP_GOING)
def tries_keeping_going(asking: Asking) -> None:
    asking.ask(Action.KEEP_GOING, 1, lambda now: now.keeps_going)
    asking.ask(Action.KEEP_GOING, 0, lambda now: not now.keeps_going)


@fulfils(Action.IMPORT)
def tries_import(asking: Asking) -> None:
    asking.hears(Action.IMPORT, "none.mp4", "none.mp4")


@fulfils(
    Action.PLAY,
    Action.EVENT_BEFORE,
    Action.EVENT_AFTER,
    Action.SHOW_NOW,
    Action.SEEK_BACK,
    Action.SEEK_FORWARD,
    Action.SEEK,
    Action.SPEED,
)
def tries_time(asking: Asking) -> None:
    asking.hears(Action.PLAY, None, "now")
    asking.ask(Action.EVENT_BEFORE, None, looks_back)
    asking.ask(Action.SHOW_NOW, None, lambda now: not looks_back(now))
    asking.until(lambda now: now.timeline.length_s > 2)
    first = asking.ask(Action.SEEK, 0, looks_back).timeline.time_s
    asking.ask(Action.SEEK_FORWARD, None, lambda now: now.timeline.time_s > first + 0.9)
    asking.ask(Action.SEEK_BACK, None, lambda now: now.timeline.time_s < first + 0.1)
    asking.ask(Action.EVENT_AFTER, None, lambda now: now.timeline.time_s > first)
    asking.ask(Action.SPEED, 200, lambda now: now.timeline.speed == 2)
    asking.ask(Action.SEEK, 0, looks_back)
    asking.ask(Action.PLAY, None, lambda now: now.timeline.time_s > first)


@fulfils(
    Action.DOOR,
    Action.AIM_BOX,
    Action.TAKE_BOX,
    Action.LIGHT,
    Action.PUT_BOX,
    Action.UNDO_CHANGE,
    Action.WATCH_IT_LEARN,
)
def tries_world(asking: Asking) -> None:
    about_one = (Action.DOOR, Action.AIM_BOX, Action.TAKE_BOX, Action.LIGHT)
    alone = (Action.PUT_BOX, Action.UNDO_CHANGE, Action.WATCH_IT_LEARN)
    wishes = [*((action, 1) for action in about_one), *((action, None) for action in alone)]
    for action, value in (*wishes, (Action.PUT_BOX, (1.5, 2.0))):
        asking.hears(action, value, "world")
        asking.hears(Action.PLAY, None, "now")  # The same words again would be no new message.


@fulfils(Action.PLAY_DRIVE)
def tries_a_recorded_drive(asking: Asking) -> None:
    asking.hears(Action.PLAY_DRIVE, None, "no recorded drive")


@fulfils(Action.ALIGN_PLAN, Action.POINT_ON_PLAN, Action.UNDO_PLAN_CLICK, Action.USE_ALIGNMENT)
def tries_the_floor_plan(asking: Asking) -> None:
    asking.hears(Action.ALIGN_PLAN, None, "no floor plan")
    asking.app.harness.state.alignment = FloorPlanClicks(laid_room())
    asking.ask(Action.ALIGN_PLAN, None, lambda now: now.floor_plan and now.floor_plan.is_aligning)
    asking.hears(Action.USE_ALIGNMENT, None, "at least 2")
    asking.ask(Action.PICK, asking.far, lambda now: now.floor_plan and now.floor_plan.node == asking.far)
    asking.ask(Action.POINT_ON_PLAN, (1.0, 1.0), lambda now: now.floor_plan and now.floor_plan.pairs == 1)
    asking.ask(Action.UNDO_PLAN_CLICK, None, lambda now: now.floor_plan and now.floor_plan.pairs == 0)
    asking.ask(Action.CANCEL, None, lambda now: now.floor_plan and not now.floor_plan.is_aligning)


@fulfils(Action.QUESTION, Action.TELL, Action.FOLLOW, Action.PICK_EDGE)
def tries_questions(asking: Asking) -> None:
    asking.ask(Action.QUESTION, str(QuestionName.EDGE), lambda now: now.inspection.question == QuestionName.EDGE)
    asking.ask(Action.PICK, asking.far, lambda now: now.inspection.selection.node == asking.far)
    edge = tuple(map(int, next(iter(asking.now.moment.graph.edges))))
    asking.ask(Action.PICK_EDGE, (edge[0], edge[1]), lambda now: now.inspection.selection.edge == edge)
    asking.hears(Action.TELL, "three")
    asking.hears(Action.FOLLOW, 10**6, "answer")


EXAMPLES: Sequence[Value] = (None, 1, "a.rrd", (1.0, 2.0))


@pytest.mark.parametrize("trial", dict.fromkeys(TRIALS.values()), ids=lambda trial: trial.__name__)
def test_a_wish_that_makes_sense_is_fulfilled(asking: Asking, trial: Callable[[Asking], None]) -> None:
    trial(asking)


def test_each_wish_is_tried() -> None:
    assert TRIALS.keys() == set(Action)


def refused_in() -> dict[Mode, list[Action]]:
    """Return a mode for each wish that is not always possible, in which it is tried."""
    found: dict[Mode, list[Action]] = {mode: [] for mode in (Mode.TELEOP, Mode.REPLAY, Mode.PAUSED, Mode.BUILDING)}
    for action in Action:
        if action.wish.modes != ANYWHERE:
            found[next(mode for mode in found if mode not in action.wish.modes)].append(action)
    return found


@pytest.mark.parametrize(("mode", "actions"), refused_in().items(), ids=["driving", "replay", "paused", "building"])
def test_a_wish_that_makes_no_sense_now_is_refused(
    asking: Asking, keep_busy: Callable[[], None], mode: Mode, actions: list[Action]
) -> None:
    if mode is Mode.BUILDING:
        keep_busy()
    asking.enter(mode)
    for action in actions:
        asking.hears(action, next(each for each in EXAMPLES if fits(each, action.wish.takes)), "not possible")
        assert asking.now.mode is mode
