"""A finding is one sentence or more for a person, and its parts for a program."""

import json
from dataclasses import dataclass

from ltvn_core.findings import Finding, Severity, WithDoubts, findings_of
from ltvn_core.verbs.verb import to_json, to_text

FAR = Finding("No image was recognised.", remedy="Drive more slowly.", where="tuesday.rrd")


@dataclass(frozen=True)
class Summary(WithDoubts):
    """What a verb answers."""

    findings: tuple[Finding, ...]


def test_a_summary_in_json_holds_findings_as_texts_and_in_parts() -> None:
    said = json.loads(to_json(Summary((FAR, *findings_of(["The clock stands still."])))))
    assert said["doubts"] == ["No image was recognised. Drive more slowly.", "The clock stands still."]
    parts = {"text": FAR.text, "severity": "WARN", "remedy": FAR.remedy, "where": "tuesday.rrd"}
    assert said["findings"][0] == parts


def test_a_summary_as_text_says_each_finding_in_a_line() -> None:
    assert f"\n  {FAR}" in to_text(Summary((FAR,)))


def test_a_finding_about_one_of_several_begins_with_its_name() -> None:
    found = Finding("The clock stands still.", Severity.ERROR).of("monday.rrd")
    assert str(found) == "monday.rrd: The clock stands still."
    assert (found.where, found.severity) == ("monday.rrd", Severity.ERROR)
