"""Documents stay short enough to be read."""

from tests.repository import ROOT
from tools.word_counts import main, words_of


def test_tables_pictures_and_commands_are_not_read_as_sentences() -> None:
    looked_up = "| a | b |\n| --- | --- |\n\n![a picture](a.png)\n\n    ltvn app\n\n```\ncode\n```\n"
    page = f"# A title\n\nTwo words.\n\n{looked_up}"

    assert words_of(page) == len(["#", "A", "title", "Two", "words."])


def test_all_documents_keep_to_their_budgets() -> None:
    assert main([str(ROOT)]) == 0
