"""`ltvn report` shows every number of the results, asks nothing of other machines, and takes nothing for markup."""

import gzip
import json
import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import EncounterCounts, FailureCause, QueryResult
from ltvn_core.evaluation.reports.evaluation_files import find_results
from ltvn_core.evaluation.reports.evaluation_page import render_page
from ltvn_core.evaluation.reports.failure_gallery import FailureRow, data_url
from ltvn_core.evaluation.reports.figure_style import FigurePalette
from ltvn_core.evaluation.results import Run, append_rows, read_queries
from ltvn_core.verbs.report import ReportSummary, ReportVerb
from tests.core.data.recording import example_recording
from tests.core.evaluation.reports.fake_results import (
    few_results,
    keep,
    make_lifelong_result,
    make_trial,
    make_world_result,
    run_of,
    runs_of,
    with_columns,
)
from tools.results_page import markdown_tables

INK = FigurePalette((0.1, 0.3, 0.7), (0.8, 0.3, 0.1), (0.5, 0.2, 0.6))
VOID = {"meta", "img", "br", "link", "input", "hr"}


class Reader(HTMLParser):
    """Reads a page as a browser does: what is open, what is asked for, and what can be read."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.asked: list[str] = []
        self.ids: Counter[str] = Counter()
        self.links: list[str] = []
        self.tags: Counter[str] = Counter()
        self.words: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        given = dict(attrs)
        self.asked += [value for name in ("src", "srcset", "poster", "data") if (value := given.get(name))]
        self.links += [value for name in ("href", "xlink:href") if (value := given.get(name))]
        self.ids[given.get("id") or f"nameless {len(self.ids)}"] += 1
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.fixture(scope="module")
def results() -> tuple[Run, ...]:
    return few_results()


@pytest.fixture(scope="module")
def folder(results: tuple[Run, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results as `ltvn evaluate` and `ltvn lifelong` leave them, in folders of scene and seed."""
    runs = tmp_path_factory.mktemp("runs")
    for run in results:
        keep(runs, run)
    return runs


@pytest.fixture(scope="module")
def made(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> ReportSummary:
    """Their report, which has taken the place of an older one."""
    output = tmp_path_factory.mktemp("report") / "report.html"
    output.write_text("old", encoding="utf-8")
    output.with_suffix(".json").write_text("old", encoding="utf-8")
    made = ReportVerb(folder=folder, output=output).run()
    assert isinstance(made, ReportSummary)
    return made


def test_the_report_is_one_page_that_asks_nothing_of_other_machines(made: ReportSummary) -> None:
    html = made.output.read_text(encoding="utf-8")
    read = Reader(html)
    assert read.open == []
    assert read.tags["svg"] >= 6
    assert "http://" not in html
    assert "https://" not in html
    assert all(address.startswith("data:") for address in read.asked)
    assert "@import" not in html
    assert not re.search(r"url\((?!#)", html)
    assert max(read.ids.values()) == 1
    assert {link[1:] for link in read.links if link.startswith("#")} <= read.ids.keys()


def test_the_page_holds_every_number_of_its_tables(made: ReportSummary, results: tuple[Run, ...]) -> None:
    words = {word.strip() for word in Reader(made.output.read_text(encoding="utf-8")).words}
    lines = [line for table in markdown_tables(results).values() for line in table.splitlines()]
    shown = [line for line in lines if not line.startswith("| ---")]
    assert len(shown) > 30
    for line in shown:
        for cell in line.split("|")[1:-1]:
            assert cell.strip() in words


def test_the_json_beside_the_page_is_all_that_was_found(made: ReportSummary, results: tuple[Run, ...]) -> None:
    found = json.loads(made.results.read_text(encoding="utf-8"))
    episodes = [episode for run in results for known in run.maps for episode in known.episodes]
    assert len(found) == sum(len(run.maps) + len(run.queries) for run in results) + len(episodes)
    assert all({"scene", "seed", "method", "preset"} <= line.keys() for line in found)
    static = [episode for run in results if not run.queries for known in run.maps for episode in known.episodes]
    assert (made.trials, made.lifelong, made.worlds) == (len(results) - 2, 2, 0)
    assert (made.episodes, made.failed) == (len(static), sum(not episode.reached for episode in static))


def test_names_are_never_taken_for_markup(tmp_path: Path) -> None:
    name, command = "<b>|&amp;", "ltvn evaluate '<script>alert(1)</script>'"
    trial = with_columns(replace(make_trial("<b>"), command=command), scene=name)
    run = make_lifelong_result(points=2)
    columns = replace(run.columns, scene=name)
    maps = tuple(with_columns(known, scene=name) for known in run.maps)
    found = (*runs_of(trial), replace(run, columns=columns, maps=maps))
    failures = [FailureRow(trial, episode, recording=tmp_path / "<i>.rrd") for episode in trial.episodes]
    read = Reader(render_page(found, failures, INK, folder=tmp_path))
    assert read.open == []
    assert read.tags.keys().isdisjoint({"b|&amp;", "i"})
    assert read.tags["script"] == 1  # The page's own.
    assert name in read.words
    assert command in read.words
    assert "\\|&amp;amp;" in markdown_tables(found)["main"]
    assert "<b>" not in markdown_tables(found)["main"]


def test_worlds_that_change_and_people_have_tables_on_the_page(tmp_path: Path) -> None:
    met = EncounterCounts(
        encounters=3, touched=1, avoidable=0, gave_way=2, closest_m=0.0, closest_each_m=(0.0, 0.3, 0.6), stood_s=6.0
    )
    made = make_world_result("people")
    keep(tmp_path, replace(made, queries=(replace(made.queries[0], people=met), *made.queries[1:])))
    keep(tmp_path, make_world_result())
    summary = ReportVerb(folder=tmp_path, output=tmp_path / "report.html").run()
    assert isinstance(summary, ReportSummary)
    assert (summary.worlds, summary.trials) == (2, 0)
    html = summary.output.read_text(encoding="utf-8")
    assert "What if the world changes?" in html
    assert "Whom did it meet?" in html


def test_a_folder_without_results_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=re.escape(str(tmp_path))):
        ReportVerb(folder=tmp_path, output=tmp_path / "report.html").run()
    with pytest.raises(OptionError, match="no folder"):
        ReportVerb(folder=tmp_path / "nowhere").run()
    with pytest.raises(OptionError, match=r"\.html"):
        ReportVerb(folder=tmp_path, output=tmp_path / "report.pdf").run()


@pytest.mark.parametrize("text", ["{}", "[1, 2]", "3", '{"scene": 3}'])
def test_a_line_that_is_no_result_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "broken.jsonl").write_text(text, encoding="utf-8")
    with pytest.raises(OptionError, match=r"broken\.jsonl"):
        ReportVerb(folder=tmp_path, output=tmp_path / "report.html").run()
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize("name", ["ltvn-25.trial.json", "ltvn-7-every-1-25.lifelong.json", "truth.world.json.gz"])
def test_results_of_older_versions_are_refused(tmp_path: Path, name: str) -> None:
    keep(tmp_path, run_of(make_trial()))
    (tmp_path / "demo-0").mkdir()
    (tmp_path / "demo-0" / name).write_text("{}", encoding="utf-8")
    with pytest.raises(OptionError, match=f"{name}.*--folder"):
        find_results(tmp_path)


def test_results_that_are_kept_gzipped_are_read_like_plain_ones(tmp_path: Path) -> None:
    for run in (*runs_of(make_trial()), make_lifelong_result(points=2)):
        keep(tmp_path, run)
    plain = find_results(tmp_path)
    for path in tmp_path.rglob("*.jsonl"):
        path.with_name("rows.jsonl.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    assert find_results(tmp_path) == plain


def test_what_is_no_gzip_file_is_named(tmp_path: Path) -> None:
    whole = gzip.compress(b"{}" * 1000)
    for damaged in (b"plain text", whole[:20], b"\x1f\x8b"):
        (tmp_path / "rows.jsonl.gz").write_bytes(damaged)
        with pytest.raises(OptionError, match=r"rows\.jsonl\.gz"):
            find_results(tmp_path)


def test_two_folders_with_results_of_one_run_are_an_error(tmp_path: Path) -> None:
    for label in ("ltvn", "again"):
        keep(tmp_path, run_of(make_trial()), label)
    with pytest.raises(OptionError, match=r"again.*same run"):
        find_results(tmp_path)


def test_lines_of_a_run_are_added_up_however_many_files_they_are_in(tmp_path: Path) -> None:
    path = keep(tmp_path, run_of(make_trial(plan=False)))
    (run,) = find_results(tmp_path)
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[:7]), encoding="utf-8")
    path.with_name("more.jsonl").write_text("\n".join(lines[6:]), encoding="utf-8")
    assert find_results(tmp_path) == (run,)


def test_any_cut_costs_the_incomplete_line_alone(tmp_path: Path) -> None:
    path = keep(tmp_path, run_of(trial := make_trial(plan=False)))
    whole = path.read_bytes()
    for size in range(0, len(whole), 997):
        path.write_bytes(whole[:size])
        kept = read_queries(path)
        assert kept == list(trial.episodes[: len(kept)])
        append_rows(path, trial.columns, trial.episodes[-1:])
        assert read_queries(path) == [*kept, trial.episodes[-1]]


def test_an_image_is_carried_in_its_address_and_anything_else_refused() -> None:
    assert data_url(b"\xff\xd8\xff\xe0").startswith("data:image/jpeg;base64,")
    assert data_url(b"\x89PNG\r\n").startswith("data:image/png;base64,")
    with pytest.raises(OptionError, match="JPEG"):
        data_url(b"<svg>")


def test_a_failed_episode_shows_both_images_and_the_command_for_its_recording(tmp_path: Path) -> None:
    episode = QueryResult(
        query=7,
        start=0,
        goal=4,
        reached=False,
        outcome="arrived",
        failure=FailureCause.WRONG_ARRIVAL,
        steps=90,
        collisions=1,
        path_m=2.0,
        shortest_m=2.0,
        position_error_m=1.5,
        yaw_error_rad=0.1,
    )
    file = keep(tmp_path / "runs", run_of(replace(make_trial(), episodes=(replace(episode, after=0),))))
    example_recording.write(file.parent.parent / "drive.rrd")
    recording = file.parent / "failure-0007.rrd"
    example_recording.write(recording)
    ReportVerb(folder=tmp_path / "runs", output=tmp_path / "report.html").run()
    read = Reader((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert len([address for address in read.asked if address.startswith("data:image/jpeg")]) == 2
    assert "runs/tune-1-0/ltvn/failure-0007.rrd" in read.links
    (command,) = [word for word in read.words if word.startswith("ltvn replay")]
    assert re.fullmatch(rf"ltvn replay {re.escape(str(recording))} --at \d+\.\d --ask edge", command)


def test_an_episode_that_was_not_recorded_shows_the_command_that_does() -> None:
    trial = replace(make_trial(episodes=40), command="ltvn evaluate --scene tune-1 --record-failures 2 --episodes 40")
    failed = [episode for episode in trial.episodes if not episode.reached]
    row = FailureRow(trial, failed[2])
    assert row.command is None
    assert row.recording_command == "ltvn evaluate --scene tune-1 --episodes 40 --record-failures 3"
    assert FailureRow(replace(trial, command="ltvn lifelong --scene tune-1"), failed[2]).recording_command is None


def test_a_damaged_drive_costs_the_images_and_nothing_else(tmp_path: Path) -> None:
    trial = make_trial(plan=False)
    there = keep(tmp_path / "runs", run_of(trial)).parent
    (there.parent / "drive.rrd").write_bytes(b"no recording")
    for episode in trial.episodes:
        (there / f"failure-{episode.query:04d}.rrd").write_bytes(b"no recording")
    ReportVerb(folder=tmp_path / "runs", output=tmp_path / "report.html").run()
    read = Reader((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert [word for word in read.words if word.startswith("ltvn replay")]
    assert not any("--at" in word for word in read.words)
