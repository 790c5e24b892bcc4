"""Links that show somebody the same thing: what is written is read again, and nothing else gets through."""

from urllib.parse import urlsplit

import pytest

from ltvn_core.errors import OptionError
from ltvn_viz.session.inspection import QuestionName, Selection
from ltvn_viz.session.share_links import QUESTION_WORDS, commands_from_link, link, question_commands
from ltvn_viz.wishes import commands as c


def test_a_link_is_read_as_it_was_written() -> None:
    address = link("a b&c=ä.rrd", 12.34, QuestionName.WHAT_IF, Selection(12, (12, 40)))
    (opening,) = commands_from_link(urlsplit(address).query)
    assert isinstance(opening, c.OpenRecording)
    assert (opening.name, opening.at_s) == ("a b&c=ä.rrd", 12.34)
    question, pointing = opening.then
    assert isinstance(question, c.Ask)
    assert question.value == QuestionName.WHAT_IF
    assert isinstance(pointing, c.PointAt)
    assert (pointing.node, pointing.target) == (12, 40)


def test_a_link_to_a_node_names_the_node_alone() -> None:
    (opening,) = commands_from_link(urlsplit(link("a.rrd", 0.0, selection=Selection(7))).query)
    assert isinstance(opening, c.OpenRecording)
    (pointing,) = opening.then
    assert isinstance(pointing, c.PointAt)
    assert (pointing.node, pointing.target) == (7, None)


def test_an_earlier_link_that_carries_a_view_still_shows_the_rest() -> None:
    (opening,) = commands_from_link("replay=a.rrd&at=3&node=7&camera=1,2,3,4,5,6,0,0,1")
    assert isinstance(opening, c.OpenRecording)
    assert (opening.at_s, len(opening.then)) == (3.0, 1)


@pytest.mark.parametrize("query", ["", "?", "token=x", "initialCameraPosition=1,2,3"])
def test_an_address_that_is_no_link_asks_for_nothing(query: str) -> None:
    assert commands_from_link(query) == ()


@pytest.mark.parametrize(
    "query",
    [
        "replay=a.rrd&at=soon",
        "replay=a.rrd&at=-1",
        "at=nan&replay=a",
        "edge=1-2-3",
        "edge=1",
        "edge=x-y",
        "node=1-2",
        "node=-1",
        "tool=explode",
        "&".join(f"a{k}=1" for k in range(99)),
    ],
)
def test_a_link_that_makes_no_sense_is_refused_in_words(query: str) -> None:
    with pytest.raises(OptionError, match=r"[Ll]ink"):
        commands_from_link(query)


def test_a_question_is_asked_by_its_word_and_a_wrong_word_names_the_right_ones() -> None:
    (asked,) = question_commands("blame", QUESTION_WORDS)
    assert isinstance(asked, c.Ask)
    assert asked.value == QuestionName.EDGE.value
    assert question_commands("", QUESTION_WORDS) == ()
    with pytest.raises(OptionError, match=r"--ask, names the tool “why”.*blame"):
        question_commands("why", QUESTION_WORDS)
