"""The Why tab's machinery: questions, links into time, clicks that ask instead of navigate."""

from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Mode
from tests.viz.debugger.answer_links import links, words
from tests.viz.session_harness import SessionHarness, said


def an_edge(harness: SessionHarness) -> tuple[int, int]:
    return next(iter(harness.state.live_map.graph.edges))


def link_numbers(snapshot: Snapshot) -> list[int]:
    return [number for number, _ in links(snapshot)]


def test_without_a_question_nothing_is_asked_and_a_click_navigates(harness: SessionHarness) -> None:
    source, _ = an_edge(harness)
    snapshot = harness.do(c.PickNode(source))
    assert snapshot.inspection.question is QuestionName.NONE
    assert snapshot.inspection.html == ""
    assert snapshot.mode is Mode.NAVIGATING


def test_with_a_question_clicks_on_a_node_and_its_neighbour_ask_about_the_edge_between(harness: SessionHarness) -> None:
    source, target = an_edge(harness)
    harness.do(c.ChooseQuestion(QuestionName.EDGE), c.PickNode(source))
    snapshot = harness.do(c.PickNode(target))
    assert snapshot.mode is Mode.TELEOP
    assert snapshot.inspection.selection.edge == (source, target)
    assert f"{source} → {target}" in words(snapshot)
    assert {source, target} <= snapshot.inspection.answer.overlay.nodes.keys()
    assert snapshot.inspection.answer.overlay.ghosts


def test_a_link_of_a_view_that_was_just_replaced_leads_where_it_said(harness: SessionHarness) -> None:
    source, target = an_edge(harness)
    shown = harness.do(c.ChooseQuestion(QuestionName.EDGE), c.PointAt(source, target))
    back = link_numbers(shown)[0]
    turned = harness.do(c.FollowLink(back))
    again = harness.do(c.FollowLink(back))
    assert turned.inspection.selection.edge == (target, source)
    assert again.inspection.selection.edge == (target, source)
    assert again.message is None
    assert back not in link_numbers(again)


def test_a_link_of_another_question_says_that_it_is_gone(harness: SessionHarness) -> None:
    source, target = an_edge(harness)
    shown = harness.do(c.ChooseQuestion(QuestionName.EDGE), c.PointAt(source, target))
    gone = harness.do(c.ChooseQuestion(QuestionName.TIME), c.FollowLink(link_numbers(shown)[0]))
    assert gone.inspection.selection.edge == (source, target)
    assert "replaced before your click arrived" in said(gone)


def test_the_live_run_can_be_looked_back_at_and_come_back_from(harness: SessionHarness) -> None:
    harness.do(c.PickNode(max(harness.state.live_map.graph.nodes)))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    end = harness.now.moment.stamp
    before = harness.do(c.Seek(0.2))
    now = harness.do(c.Seek(1e6))
    assert before.moment.stamp < end
    assert now.moment.stamp >= end


def test_text_that_no_question_asked_for_are_answered_with_what_to_do(harness: SessionHarness) -> None:
    snapshot = harness.do(c.SubmitText("hello"))
    assert "Choose a question first" in said(snapshot)
