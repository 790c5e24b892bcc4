"""Converts an answer to plain text for a terminal, and to JSON for a program.

Owns both formats. A link becomes its text; images are named by their frames.
"""

from collections.abc import Callable
from typing import Any, assert_never

from ltvn_core.analysis.answer import (
    Address,
    Answer,
    Block,
    CalibrationChart,
    Chart,
    Code,
    Coloured,
    Copyable,
    Download,
    Hint,
    Inline,
    Key,
    Line,
    Link,
    Paragraph,
    Pending,
    Picture,
    Pictures,
    PresenceChart,
    Step,
    StepChart,
    Strong,
    Table,
    Term,
)


def answer_text(answer: Answer) -> str:
    """Return an answer as lines of text; tables are aligned in columns."""
    return "\n".join(_block_text(block) for block in answer.blocks)


def answer_json(answer: Answer, *, target: Callable[[object], Any] = str) -> list[dict[str, Any]]:
    """Return an answer as JSON objects, one per block; `target` converts the command of a link to JSON."""
    return [_block_json(block, target) for block in answer.blocks]


def line_text(line: Line) -> str:
    """Return a line as text."""
    return "".join(map(_inline_text, line))


def _inline_text(part: Inline) -> str:
    match part:
        case str():
            return part
        case Strong(text) | Code(text) | Coloured(text):
            return text
        case Term(word, shown):
            return shown or word
        case Key(text=text):
            return f"{text} "
        case Link(label) | Download(label):
            return label
        case Address(label, url):
            return f"{label} <{url}>"
        case Copyable(text=text):
            return text
        case Step(typed=typed):
            return typed
        case Hint(text, about):
            return f"{text} ({about})" if about and about != text else text
        case _:
            assert_never(part)


def _block_text(block: Block) -> str:
    match block:
        case Paragraph(parts):
            return line_text(parts).rstrip()
        case Table(head, rows):
            return _columns([list(head), *([line_text(cell) for cell in row] for row in rows)])
        case StepChart() | CalibrationChart() | PresenceChart():
            return _chart_text(block)
        case Pictures(pictures):
            return "\n".join(f"[{picture.caption}: {_frame_text(picture)}]" for picture in pictures)
        case Pending(text, title):
            return f"{title} {text} …".strip()
        case _:
            assert_never(block)


def _columns(rows: list[list[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def _chart_text(chart: Chart) -> str:
    match chart:
        case StepChart(points, x, y):
            return f"{y.label} over {x.label}: " + ", ".join(f"{at:g}: {value:.2f}" for at, value in points)
        case CalibrationChart(cells):
            return "\n".join(f"p {said:.2f}: true {true:.2f}, of {count} edges" for said, true, count in cells)
        case PresenceChart(points, looks, now):
            seen = ", ".join(f"{look.stamp_s:.0f} s {'open' if look.present else 'blocked'}" for look in looks)
            known = [p for at, p in points if at <= now]
            return f"p open now: {known[-1] if known else 1.0:.2f}; seen: {seen or 'never'}"
        case _:
            assert_never(chart)


def _frame_text(picture: Picture) -> str:
    return "no image" if picture.observation is None else f"image {picture.observation.step}"


def _block_json(block: Block, target: Callable[[object], Any]) -> dict[str, Any]:
    match block:
        case Paragraph(parts):
            return {"kind": "text", "text": line_text(parts), "links": _links_json(parts, target)}
        case Table(head, rows):
            cells = [[line_text(cell) for cell in row] for row in rows]
            links = [[_links_json(cell, target) for cell in row] for row in rows]
            return {"kind": "table", "head": list(head), "rows": cells, "links": links}
        case StepChart(points, x, y, limits=limits, now=now):
            return {
                "kind": "chart",
                "x": x.label,
                "y": y.label,
                "points": [list(point) for point in points],
                "limits": {name: at for at, name in limits},
                "now": now,
            }
        case CalibrationChart(cells):
            return {"kind": "calibration", "cells": [list(cell) for cell in cells]}
        case PresenceChart(points, looks, now):
            return {
                "kind": "presence",
                "points": [list(point) for point in points],
                "looks": [{"time": look.stamp_s, "open": look.present} for look in looks],
                "now": now,
            }
        case Pictures(pictures):
            return {"kind": "images", "images": [_picture_json(picture) for picture in pictures]}
        case Pending(text, title):
            return {"kind": "pending", "text": f"{title} {text}".strip()}
        case _:
            assert_never(block)


def _links_json(line: Line, target: Callable[[object], Any]) -> list[dict[str, Any]]:
    return [{"label": part.label, "to": target(part.to)} for part in line if isinstance(part, Link)]


def _picture_json(picture: Picture) -> dict[str, Any]:
    seen, waypoint = picture.observation, picture.waypoint
    return {
        "frame": None if seen is None else seen.step,
        "caption": picture.caption,
        "waypoint": None if waypoint is None else [float(part) for part in waypoint],
    }
