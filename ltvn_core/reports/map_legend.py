"""Title, legend and scale bar below a drawn map, so that the figure can be read where nothing explains it."""

from collections.abc import Iterator
from html import escape

from ltvn_core import palette
from ltvn_core.evaluation.map_layout import MapLayout

_TEXT_SHARE = 0.022
"""Height of the letters, in widths of the figure."""
_BAR_SHARE = 0.25
"""The scale bar takes at most so much of the width."""
_SHORTEST_M = 0.01
_LINES = 4.5
"""Height of all below the map, in heights of its letters."""


def bar_length_m(width_m: float) -> float:
    """Return a round length (1, 2 or 5 times a power of ten, metres) for the scale bar of a map of that width."""
    most = max(_BAR_SHARE * width_m, _SHORTEST_M)
    return max(length for power in range(-2, 5) for factor in (1, 2, 5) if (length := factor * 10.0**power) <= most)


def legend_height_m(width_m: float) -> float:
    """Return how much room the legend needs below a map of that width."""
    return _LINES * _TEXT_SHARE * width_m


def map_legend(drawn: MapLayout, left_m: float, top_m: float, width_m: float) -> Iterator[str]:
    """Yield parts of an SVG in metres, y down, that fill a strip below the map."""
    letter = _TEXT_SHARE * width_m
    counts = f"{len(drawn.graph.nodes):,} nodes, {len(drawn.graph.edges):,} edges"
    first = top_m + 1.5 * letter
    second = top_m + 3.4 * letter
    left = left_m + letter
    yield f'<g font-size="{letter:.4f}" style="font-family:sans-serif" fill="{palette.TEXT.css}">'
    yield _text(left, first, f"{drawn.title}: {counts}", letter)
    yield from _scale_bar(left, second, width_m, letter)
    yield from _ramp(left + (_BAR_SHARE + 0.1) * width_m, second, letter)
    if drawn.simulated:
        yield from _spurious(left + (_BAR_SHARE + 0.37) * width_m, second, letter)
    yield "</g>"


def _scale_bar(left: float, base: float, width_m: float, letter: float) -> Iterator[str]:
    length = bar_length_m(width_m)
    height = 0.4 * letter
    yield (
        f'<path d="M{left:.3f} {base - height:.3f}v{height:.3f}h{length:.3f}v{-height:.3f}" '
        f'style="fill:none;stroke:{palette.TEXT.css};stroke-width:{0.1 * letter:.4f}"/>'
    )
    yield _text(left + length + 0.5 * letter, base, f"{length:g} m", letter)


def _ramp(left: float, base: float, letter: float) -> Iterator[str]:
    stops = "".join(
        f'<stop offset="{number / (len(palette.PROBABILITY_RAMP) - 1):g}" '
        f'stop-color="{palette.Rgb8(*map(int, stop)).css}"/>'
        for number, stop in enumerate(palette.PROBABILITY_RAMP)
    )
    yield f'<defs><linearGradient id="ramp">{stops}</linearGradient></defs>'
    yield _text(left, base, "edge p 0", letter)
    yield (
        f'<rect x="{left + 4.6 * letter:.3f}" y="{base - 0.65 * letter:.3f}" width="{4 * letter:.3f}" '
        f'height="{0.6 * letter:.3f}" fill="url(#ramp)"/>'
    )
    yield _text(left + 9 * letter, base, "1", letter)


def _spurious(left: float, base: float, letter: float) -> Iterator[str]:
    middle = base - 0.35 * letter
    yield f'<path class="s" d="M{left:.3f} {middle:.3f}h{2 * letter:.3f}"/>'
    yield _text(left + 2.4 * letter, base, "nobody can drive it", letter)


def _text(x: float, y: float, words: str, letter: float) -> str:
    # Elements of their own size: the figure's style has another for what is written into the map.
    return f'<text x="{x:.3f}" y="{y:.3f}" style="font-size:{letter:.4f}px">{escape(words)}</text>'
