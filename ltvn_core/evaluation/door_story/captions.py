"""The words of the story: one plain sentence for each thing that happens."""

from collections.abc import Sequence

from ltvn_core.evaluation.door_story.stage_search import Stage
from ltvn_core.evaluation.door_story.story_facts import StoryFacts
from ltvn_core.navigation.events import Outcome
from ltvn_core.worlds.world_change import OWN_PREFIX

NO_STORY = "No way in this map leads from here through a door. Map more rooms, and try again from one of them."

_SEVERAL = 3
"""A way that was not in the map gives so many nodes; one alone is no news."""


class Captions:
    """What was told so far, and how each thing is told."""

    def __init__(self, door_names: Sequence[str]) -> None:
        """Call the doors by these names."""
        self._names = door_names
        self.told: list[str] = []
        self._told_once: set[str] = set()

    def tell(self, text: str) -> None:
        """Say something."""
        self.told.append(text)

    def no_story(self) -> None:
        """Nothing can be told here."""
        self.tell(NO_STORY)

    def way_is_shown(self, moved_away: str | None, room: str) -> None:
        """The robot is led along a way that its map lacks."""
        if moved_away is None:
            self.tell(f"There is a way through the {room} that the map does not know. The robot is led along it once.")
            return
        thing = moved_away.removeprefix(OWN_PREFIX).rpartition("-")[0].replace("-", " ")
        self.tell(f"Somebody moved the {thing} out of the {room}: now there is a way. The robot is led along it once.")

    def sets_out(self, stage: Stage) -> None:
        """The robot drives by its map."""
        other = "The map knows another way, too." if stage.has_way_round else "The map knows no other way."
        self.tell(f"Now it drives by itself, to node {stage.goal}, through {self._door(stage.door)}. {other}")

    def door_closes(self, door: int) -> None:
        """Somebody closes it."""
        self.tell(f"Somebody closes {self._door(door)}. The robot does not know it yet.")

    def plan_turns(self, nodes: int) -> None:
        """A plan leads round the door."""
        self._tell_once(f"The plan turns: the robot goes round by the other way, {nodes} nodes long.")

    def is_called_back(self) -> None:
        """There is no other way."""
        self.tell("The map knows no other way, so the robot is called back.")

    def no_door_on_the_way(self) -> None:
        """It drove another way than was thought."""
        self.tell("The robot found a way that does not lead through the door. Try again from another place.")

    def tries_again_unseeing(self) -> None:
        """The robot was stopped and did not find out by what."""
        self.tell(
            "It did not see what is in the way, so the map learns nothing from it. It is put back and tries again."
        )

    def ended(self, outcome: Outcome) -> None:
        """The robot came to the end of its way."""
        if outcome is not Outcome.CANCELLED:
            self.tell("The robot arrived." if outcome is Outcome.ARRIVED else f"The robot gives up ({outcome}).")

    def door_opens(self, door: int, wait_s: float) -> None:
        """The door is open again, and time goes by."""
        name = self._door(door)
        self.tell(
            f"{name[:1].upper()}{name[1:]} is opened, and nobody tells the robot. {_duration(wait_s)} later it stands "
            "where it began, and sets out again."
        )

    def tries_again(self) -> None:
        """A plan leads through the door again."""
        self._tell_once("After so long the map thinks that the door may be open: the plan tries it again.")

    def tell_of_map(self, facts: StoryFacts, absent: int, nodes_added: int, returned: int) -> None:
        """Tell what changed in the map since there were so many."""
        if nodes_added < _SEVERAL <= facts.nodes_added:
            self.tell("New nodes appear in the map, in green: places that it did not know.")
        if not absent and facts.absent:
            self.tell(
                "The robot sees the closed door. The edges through it fade, in magenta: absent now, not forgotten."
            )
        if not returned and facts.returned:
            self.tell("The door is open. The edges through it return.")

    def summary(self, facts: StoryFacts) -> None:
        """Say what was learnt."""
        self.tell(
            f"Learnt: {len(facts.absent)} edges were absent for a while, {len(facts.returned)} of them are back; "
            f"{facts.nodes_added} nodes and {facts.edges_added} edges are new."
        )

    def _door(self, door: int) -> str:
        return f"the door {self._names[door]}"

    def _tell_once(self, text: str) -> None:
        about = text[:20]
        if about not in self._told_once:
            self._told_once.add(about)
            self.tell(text)


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds < 3600 else f"{seconds / 3600:.0f} hours"
