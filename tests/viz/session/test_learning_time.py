"""How long learning still takes: never said before it is known, and right once its parts were measured."""

import pytest

from ltvn_viz.session.learning_time import CALIBRATING, JUDGING, LEARNING, LearningTime, besides_words


class Clock:
    """A clock that stands until it is told."""

    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_one_minute_of_learning_on_a_slow_computer_is_said_to_take_what_it_takes(clock: Clock) -> None:
    lesson = LearningTime(1, clock)
    said = [lesson.left]
    for doing, seconds in (("drawing simulated rooms", 90), (JUDGING, 150), (LEARNING, 60), (CALIBRATING, 170)):
        lesson.hear(doing)
        said.append(lesson.left)
        clock.now += seconds
    assert said == [
        "more than 1 min left",
        "more than 1 min left",
        "more than 1 min left",
        "about 4 to 6 min left",
        "about 3 to 5 min left",
    ]
    assert lesson.left == "about 3 min left"
    assert lesson.besides_s == 410
    assert "took 7 min on top" in besides_words(lesson.besides_s)


def test_a_lesson_that_was_stopped_while_it_learned_says_nothing_of_the_whole(clock: Clock) -> None:
    lesson = LearningTime(3, clock)
    lesson.hear(LEARNING)
    clock.now += 60
    assert lesson.left == "about 2 min left"
    assert lesson.besides_s is None
    assert "once it has measured it" in besides_words(lesson.besides_s)
