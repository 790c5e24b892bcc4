"""JSON and TOML of strangers become values, or are refused by an error that every reader expects."""

import sys

import pytest

from ltvn_core.structured_text import parse_json, parse_toml


@pytest.mark.parametrize("levels", [150, 900, 5 * sys.getrecursionlimit(), 200_000])
def test_a_text_of_too_many_levels_is_a_wrong_value_and_nothing_worse(levels: int) -> None:
    lists = "[" * levels + "]" * levels
    objects = '{"a":' * levels + "1" + "}" * levels
    for text in (lists, objects, lists.encode()):
        with pytest.raises(ValueError, match="deep"):
            parse_json(text)
    with pytest.raises(ValueError, match="deep"):
        parse_toml(f"a = {lists}")


def test_names_with_many_dots_are_as_deep_as_tables() -> None:
    with pytest.raises(ValueError, match="deep"):
        parse_toml(f"{'a.' * 500}a = 1")


def test_a_long_toml_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(ValueError, match="characters"):
        parse_toml("# all is well\n" * 100_000)


def test_what_people_write_comes_out_as_written() -> None:
    assert parse_json('{"a": [1, {"b": null}], "c": "]]]"}') == {"a": [1, {"b": None}], "c": "]]]"}
    assert parse_json(b"[" * 50 + b"7" + b"]" * 50)
    assert parse_toml("[robot]\nname = 'x'\nsizes = [1, 2]") == {"robot": {"name": "x", "sizes": [1, 2]}}


def test_half_a_surrogate_pair_is_replaced_wherever_it_stands_and_whole_pairs_stay() -> None:
    text = r'{"\ud800": ["\udce4", {"a": "\ud83d\ude00\ude00"}], "b": 0.1}'
    for given in (text, text.encode()):
        assert parse_json(given) == {"\ufffd": [r"\xe4", {"a": "\U0001f600\ufffd"}], "b": 0.1}
