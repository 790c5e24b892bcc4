"""The one table of wishes: what a person can ask for, by a button, a key, the palette, a click, a link or a program.

Buttons, keys, palette, help, the check of messages, the words of a refusal and the session read it, so that a new wish
is a row here and a button in a panel.
"""

from enum import StrEnum
from typing import Self

from ltvn_viz.wishes.modes import ANYWHERE, DRIVING, IN_TIME, LIVE, REPLAYING, STANDING, UNDER_WAY
from ltvn_viz.wishes.wish import Audience, Edge, Need, Place, Switch, Text, Whole, Wish

LEAST_MINUTES = 1
MOST_MINUTES = 60
"""Shortest and longest fine-tuning, in minutes."""
SEEK_S = 1
"""Time in seconds by which a key moves the moment on show."""


class Action(StrEnum):
    """The wishes; the value of each is its name between page and server."""

    wish: Wish
    """The row."""

    def __new__(cls, wish: Wish) -> Self:
        """Make a member whose value is the name of its wish."""
        member = str.__new__(cls, wish.name)
        member._value_ = wish.name
        member.wish = wish
        return member

    # A row is a line of words and a line of rules.
    # fmt: off
    STOP = Wish("stop", ANYWHERE, "Stop", "stop the robot, whoever drives", "Space",
        audience=Audience.EVERYBODY, does="robot_handlers:stop")
    TAKE_OVER = Wish("take_over", ANYWHERE, "Take over", "drive from this page",
        audience=Audience.EVERYBODY, does="robot_handlers:take_over")
    RELEASE = Wish("release", ANYWHERE, "", "let another page drive", audience=Audience.EVERYBODY)
    RECORD = Wish("record", LIVE, "Record", "start recording", "KeyR",
        needs=(Need.NO_RECORDING,), does="robot_handlers:record")
    KEEP = Wish("keep", LIVE, "Keep", "end the recording and keep it", "KeyN",
        needs=(Need.RECORDING,), does="robot_handlers:keep")
    DISCARD = Wish("discard", LIVE, "Discard", "end the recording and set it aside", "Backspace",
        needs=(Need.RECORDING,), does="robot_handlers:discard")
    BUILD = Wish("build", STANDING, "Build a map", "build a map of all images", "KeyB",
        needs=(Need.FREE_MAKER,), does="map_handlers:build_map")
    UNDO_BUILD = Wish("undo_build", DRIVING, "Undo the rebuild", "restore the map from before the rebuild",
        needs=(Need.REBUILD,), does="map_handlers:undo_build")
    LEARN = Wish("learn", ANYWHERE, "Learn from this drive",
        "fine-tune the network on these images; the map does not change until you use the new weights",
        takes=Whole, does="map_handlers:start_fine_tuning")
    STOP_LEARNING = Wish("stop_learning", ANYWHERE, "Stop learning", "stop learning; the network stays as it is",
        does="fine_tuning.cancel")
    USE_WEIGHTS = Wish("use_weights", DRIVING, "Use these weights and rebuild the map",
        "use the new weights; it takes about as long as building a map",
        does="map_handlers:use_weights")
    LEAVE_WEIGHTS = Wish("leave_weights", ANYWHERE, "Discard the new weights",
        "keep the weights in use; the new ones stay on disk",
        does="fine_tuning.dismiss")
    GOAL = Wish("goal", DRIVING, "Navigate", "go to the chosen goal", "KeyG",
        takes=Whole | None, needs=(Need.OBEDIENT_ROBOT,), does="goal_handlers:navigate")
    SELECT = Wish("select", LIVE, "Choose a goal", "go to the node of an image",
        takes=Whole, does="goal_handlers:choose_goal")
    PICK = Wish("pick", ANYWHERE, "", "go to a node of the scene, or ask about it",
        takes=Whole, does="goal_handlers:pick")
    PICK_EDGE = Wish("pick_edge", ANYWHERE, "", "ask about an edge of the map",
        takes=Edge, does="command_handlers:pick_edge")
    CANCEL = Wish("cancel", ANYWHERE, "Cancel", "cancel the current activity", "Escape",
        does="robot_handlers:cancel")
    END_ACTION = Wish("end_action", UNDER_WAY, "End the action",
        "tell the robot whether the action is done that it waits for",
        takes=Switch, does="actions.answer")
    PAUSE = Wish("pause", UNDER_WAY | REPLAYING, "Pause", "pause, or continue", "KeyP",
        does="robot_handlers:pause")
    STEP = Wish("step", UNDER_WAY, "Step", "one control step, then pause", "Period",
        does="robot_handlers:step")
    PLAY_DRIVE = Wish("play_drive", DRIVING, "Play the drive again",
        "play the drive in the robot's place from its beginning",
        needs=(Need.PLAYED_DRIVE,), does="robot_handlers:play_drive")
    KEEP_GOING = Wish("keep_going", ANYWHERE, "Keep going when this page closes",
        "for long runs in simulation; otherwise a query pauses as soon as no page is open",
        takes=Switch, does="robot_handlers:keep_going")
    OPEN = Wish("open", STANDING, "Open", "open a recording",
        takes=Text, does="command_handlers:open_recording")
    IMPORT = Wish("import", STANDING, "Import", "make a recording of a drive and open it",
        takes=Text, does="map_handlers:import_source")
    CLOSE = Wish("close", REPLAYING, "Back to the robot", "leave the recording",
        does="robot_handlers:close_recording")
    SEEK_BACK = Wish("seek_back", IN_TIME, "", "go back one second", "BracketLeft",
        does="seeking:seek_by", given=-SEEK_S)
    SEEK_FORWARD = Wish("seek_forward", IN_TIME, "", "go forward one second", "BracketRight",
        does="seeking:seek_by", given=SEEK_S)
    SEEK = Wish("seek", IN_TIME, "Seek", "show a moment, given in milliseconds after the beginning",
        takes=Whole, does="seeking:seek_ms")
    PLAY = Wish("play", IN_TIME, "Play", "play, or pause the time shown",
        does="seeking:play_or_hold")
    SPEED = Wish("speed", ANYWHERE, "", "set the speed of playing, in percent",
        takes=Whole, does="seeking:set_speed")
    SHOW_NOW = Wish("show_now", IN_TIME, "Back to now", "go back to now", does="seeking:show_now")
    EVENT_BEFORE = Wish("event_before", IN_TIME, "Go to an event", "look back: go to the previous event", "Semicolon",
        does="seeking:seek_event", given=-1)
    EVENT_AFTER = Wish("event_after", IN_TIME, "", "look back: go to the next event", "Quote",
        does="seeking:seek_event", given=1)
    QUERY_BEFORE = Wish("query_before", IN_TIME, "", "look back: go to the previous query", "Minus",
        does="seeking:seek_query", given=-1)
    QUERY_AFTER = Wish("query_after", IN_TIME, "", "look back: go to the next query", "Equal",
        does="seeking:seek_query", given=1)
    DOOR = Wish("door", LIVE, "Open or close a door", "close an open door, open a closed one",
        takes=Whole, does="changeable.toggle_door")
    AIM_BOX = Wish("aim_box", LIVE, "Put a box on the floor", "then click its place on the floor",
        takes=Whole, does="changeable.aim_box")
    PUT_BOX = Wish("put_box", LIVE, "Put a box in front of the robot", "put a box in front of the robot",
        takes=Place | None, needs=(Need.WORLD,), does="changeable.put_box")
    TAKE_BOX = Wish("take_box", LIVE, "Take away a box", "take a box away",
        takes=Whole, does="changeable.take_box")
    LIGHT = Wish("light", LIVE, "Change the light", "set the brightness of the light, in percent",
        takes=Whole, does="changeable.set_light")
    UNDO_CHANGE = Wish("undo_change", LIVE, "Undo", "undo the last change of the world",
        needs=(Need.WORLD, Need.CHANGE), does="changeable.undo")
    WATCH_IT_LEARN = Wish("watch_it_learn", DRIVING, "Watch it learn",
        "watch how the map learns: a door on the robot's path closes, and opens again",
        needs=(Need.WORLD, Need.NO_STORY, Need.STORY), does="world_handlers:begin_story")
    SHOW_FLOOR = Wish("show_floor", ANYWHERE, "Show the robot's floor", "show one floor of a map with several",
        takes=Whole | None, does="floor.choose")
    ALIGN_PLAN = Wish("align_plan", ANYWHERE, "Align the floor plan by clicks",
        "lay the floor plan under the map, by clicks on both",
        needs=(Need.FLOOR_PLAN,), does="plan_clicks.toggle")
    POINT_ON_PLAN = Wish("point_on_plan", ANYWHERE, "", "point to the node's place on the plan",
        takes=Place, does="plan_clicks.take_place")
    UNDO_PLAN_CLICK = Wish("undo_plan_click", ANYWHERE, "", "take the last click of the alignment back",
        needs=(Need.FLOOR_PLAN,), does="plan_clicks.undo")
    USE_ALIGNMENT = Wish("use_alignment", ANYWHERE, "", "keep the floor plan as it lies now",
        needs=(Need.FLOOR_PLAN,), does="world_handlers:use_alignment")
    QUESTION = Wish("question", ANYWHERE, "Ask why", "choose a question",
        takes=Text, does="command_handlers:choose_question")
    TELL = Wish("tell", ANYWHERE, "", "give the question shown the text that it asks for",
        takes=Text, does="debugger.handle_text")
    FOLLOW = Wish("follow", ANYWHERE, "", "follow a link of the answer",
        takes=Whole, does="command_handlers:follow")
    HELP = Wish("help", ANYWHERE, "", "show or hide this help", "KeyH", audience=Audience.EVERYBODY)
    # fmt: on
