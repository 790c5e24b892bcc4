"""Renders an answer as HTML, with its links numbered in reading order.

Owns the markup of answers: all text from outside is escaped here and nowhere else. Images of the run become data URLs
with a waypoint drawn into them; charts are `charts`.
"""

import base64
from collections.abc import Iterator
from html import escape
from itertools import count
from typing import assert_never

import cv2
import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import (
    Address,
    Answer,
    Block,
    CalibrationChart,
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
from ltvn_viz.debugger.charts import chart_svg
from ltvn_viz.panels.html_widgets import REACHED_BY_TAB, copy_button
from ltvn_viz.server.glossary import explained

_PICTURE_PX = 288
"""Width of an image in an answer."""
_WHOLE_LETTERS = 30
"""A link of so many letters fits into one line of the narrowest page, and is not broken, for instance at a minus."""


def picture_figure(picture: Picture) -> str:
    """Return a figure of an image with its waypoint drawn into it; a grey one if there is no image."""
    seen = picture.observation
    caption = escape(picture.caption)
    if seen is None:
        return f'<figure><div class="lt-none">no image</div><figcaption>{caption}</figcaption></figure>'
    scale = _PICTURE_PX / seen.rgb.shape[1]
    way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
    rgb = np.asarray(cv2.resize(seen.rgb, None, fx=scale, fy=scale, interpolation=way), np.uint8)
    if (pole := picture.pole) is not None:
        top, foot = (tuple(round(scale * value) for value in end) for end in pole)
        colour = tuple(int(part) for part in palette.TARGET)
        cv2.line(rgb, top, foot, colour, 2, cv2.LINE_AA)
        cv2.circle(rgb, foot, 5, colour, -1, cv2.LINE_AA)
    found, coded = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 85])
    assert found
    url = "data:image/jpeg;base64," + base64.b64encode(coded.tobytes()).decode("ascii")
    return f'<figure><img src="{url}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'


def answer_html(answer: Answer) -> str:
    """Return an answer as markup; its links are numbered from 0 as `Answer.links` yields them."""
    numbers = count()
    blocks = "".join(_block(block, numbers) for block in answer.blocks)
    return f'<div class="lt lt-why">{blocks}</div>'


def _block(block: Block, numbers: Iterator[int]) -> str:
    match block:
        case Paragraph(parts):
            return f"<div>{_line(parts, numbers)}</div>"
        case Table(head, rows):
            return _table(head, rows, numbers)
        case StepChart() | CalibrationChart() | PresenceChart():
            return chart_svg(block)
        case Pictures(pictures):
            return f'<div class="lt-pair">{"".join(map(picture_figure, pictures))}</div>'
        case Pending(text, title, leave):
            return _pending(text, title, leave, numbers)
        case _:
            assert_never(block)


def _table(head: tuple[str, ...], rows: tuple[tuple[Line, ...], ...], numbers: Iterator[int]) -> str:
    heads = "".join(f"<th>{explained(each)}</th>" for each in head)
    cells = "".join("<tr>" + "".join(f"<td>{_line(cell, numbers)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<table class="lt-rows"><thead><tr>{heads}</tr></thead><tbody>{cells}</tbody></table>'


def _pending(text: str, title: str, leave: Link | None, numbers: Iterator[int]) -> str:
    bar = f'<div class="lt-bar lt-wait" role="progressbar" aria-label="{escape(text)}"><div></div></div>'
    named = f"<b>{escape(title)}</b> " if title else ""
    link = "" if leave is None else _inline(leave, numbers)
    return f"<div>{named}{escape(text)} … {link}{bar}</div>"


def _line(parts: Line, numbers: Iterator[int]) -> str:
    return "".join(_inline(part, numbers) for part in parts)


def _inline(part: Inline, numbers: Iterator[int]) -> str:
    match part:
        case str():
            return escape(part)
        case Strong(text):
            return f"<b>{escape(text)}</b>"
        case Term(word, shown):
            return explained(word, shown)
        case Code(text):
            return f"<code>{escape(text)}</code>"
        case Coloured(text, colour):
            return f'<span class="lt-inked" style="--ltvn-ink:{colour.css}">{escape(text)}</span>'
        case Key(colour, text):
            dot = f'<span class="lt-dot"><i style="color:{colour.css}">●</i></span>'
            return f'<span style="white-space:nowrap;margin-right:.8em">{dot} {escape(text)}</span>'
        case Link(label, _, about, is_button):
            title = f' title="{escape(about)}"' if about else ""
            target = f'data-ltvn-action="follow" data-id="link-{next(numbers)}"'
            if is_button:
                return f'<button type="button" class="lt-next" {target}{title}>{escape(label)}</button>'
            whole = " lt-whole" if len(label) <= _WHOLE_LETTERS else ""
            return f'<a class="lt-link{whole}" {target} {REACHED_BY_TAB}{title}>{escape(label)}</a>'
        case Address(label, url, in_new_tab):
            where = ' target="_blank" rel="noreferrer"' if in_new_tab else ""
            return f'<a href="{escape(url)}"{where} class="lt-link">{escape(label)}</a>'
        case Copyable(label, text):
            return copy_button(label, text)
        case Download(label, name, address):
            where = f'data-ltvn-download="{escape(address)}" data-name="{escape(name)}"'
            return f'<button type="button" class="lt-words" {where}>{escape(label)}</button>'
        case Step(click):
            return escape(click)
        case Hint(text, about):
            return f'<span class="lt-term" title="{escape(about)}">{escape(text)}</span>'
        case _:
            assert_never(part)
