"""The page itself: viser's client with our script and style, under a strict content policy.

Scripts run only with a nonce that is new in every response, so that HTML injected into a panel cannot run any. The page
may connect only to its own server.
"""

import json
import secrets
from http import HTTPStatus
from pathlib import Path

import viser
from websockets.http11 import Response

from ltvn_core import palette
from ltvn_viz.server.glossary import TERMS
from ltvn_viz.server.keymap import Direction, action_codes, direction_codes, help_rows, us_caps
from ltvn_viz.server.requests import HTML, LINK_PARAMETERS, reply
from ltvn_viz.server.strip_kinds import strip_tables
from ltvn_viz.wishes.wish import Audience
from ltvn_viz.wishes.wish_table import Action

_UNPACKED = "const code=td.decode(heap.subarray(up+ss,up+sz));"
"""Place in viser's loader where its application is available as text."""
_WITHOUT_SPLATS = (
    "const code=td.decode(heap.subarray(up+ss,up+sz))"
    r".replace(/\.then\((\w+)=>\w+\(\{wasmBinary:\1\}\)\)(?=;function)/,'.then(()=>new Promise(()=>{}))');"
)
"""Replacement that disables the sorter of Gaussian splats, which we do not use. It evaluates text as code when the
application starts, and the content policy would stop it with an EvalError."""

_WITHOUT_NOTICE = "<style>#webgl-software-rendering { display: none; }</style></head>"
"""Style that hides viser's notice about software rendering, which stays for ever and covers our text; the page reports
it in a line."""


def viser_page() -> str:
    """Return the HTML of viser's page with our corrections."""
    return mended((Path(viser.__file__).parent / "client/build/index.html").read_text(encoding="utf-8"))


def mended(html: str) -> str:
    """Return a page of viser, live or exported, without evaluation of text as code and without the covering notice."""
    if html.count(_UNPACKED) != 1 or html.count("</head>") != 1:
        raise RuntimeError(f"viser {viser.__version__} has another page than expected")
    return html.replace(_UNPACKED, _WITHOUT_SPLATS).replace("</head>", _WITHOUT_NOTICE)


STATIC = Path(__file__).parents[1] / "static"
SCRIPTS = (
    "theme.js",
    "token.js",
    "page.js",
    "layout.js",
    "names.js",
    "palette.js",
    "caps.js",
    "pictures.js",
    "seat.js",
    "held.js",
    "keyboard.js",
    "gamepad.js",
    "pad.js",
    "rights.js",
    "silence.js",
    "clicks.js",
    "take_along.js",
    "links.js",
    "timeline_data.js",
    "timeline_view.js",
    "timeline.js",
    "details.js",
    "plan_data.js",
    "plan_draw.js",
    "plan_pick.js",
    "plan_hands.js",
    "plan_view.js",
    "legend.js",
    "main.js",
)
STYLES = ("theme.css", "loading.css", "layout.css", "ltvn.css", "timeline.css")
_COLOURS = {
    "robot": palette.ROBOT.css,
    "node": palette.NODE.css,
    "action": palette.ACTION.css,
    "plan": palette.PLAN.css,
    "localised": palette.LOCALISED.css,
    "predicted": palette.PREDICTED_POSE.css,
    "goal": palette.GOAL.css,
    "trajectory": palette.TRAJECTORY.css,
    "course": palette.COURSE.css,
    "added": palette.EDGE_ADDED.css,
    "removed": palette.EDGE_REMOVED.css,
    "target": palette.TARGET.css,
    "accent": palette.ACCENT.css,
    "text": palette.TEXT.css,
    "background": palette.BACKGROUND.css,
}
PARTS = "page.html"
SOCKET_WORKER = "socket_worker.js"
NONCE = "{{nonce}}"
TITLE = "Lifelong Topological Visual Navigation"

POLICY = "; ".join(
    (
        "default-src 'none'",
        # viser decompresses its own code with WebAssembly; evaluation of text is not allowed.
        f"script-src 'nonce-{NONCE}' 'wasm-unsafe-eval'",
        "worker-src blob:",
        "style-src 'unsafe-inline'",
        "img-src 'self' blob: data:",
        "font-src data:",
        "connect-src 'self' blob: data:",
        "frame-ancestors 'none'",
        "base-uri 'none'",
        "form-action 'none'",
    )
)

LOADER = 'e.type="module";'
"""Place in viser's loader where it creates the script of its application, which must get the nonce."""


class IndexPage:
    """The whole HTML of the page, except the nonce."""

    def __init__(self) -> None:
        """Read the page, which is the same at every start."""
        html = _with_our_parts(_guarded(viser_page()))
        # Every user of the machine can request the page, so the response must be cheap.
        self._between_nonces = html.encode().split(NONCE.encode())

    def answer(self) -> Response:
        """Return the page with a fresh nonce; all else is the same at every start."""
        nonce = secrets.token_urlsafe(18)
        html = nonce.encode().join(self._between_nonces)
        policy = POLICY.replace(NONCE, nonce)
        return reply(HTTPStatus.OK, html, content_type=HTML, policy=policy)


def _guarded(index: str) -> str:
    """Return viser's page with our title, where only scripts with the nonce may run."""
    once = ("<script ", LOADER, "</head>", "<body>", "<title>Viser</title>")
    if any(index.count(part) != 1 for part in once):
        raise RuntimeError(f"viser {viser.__version__} has another page than expected")
    index = index.replace("<title>Viser</title>", f"<title>{TITLE}</title>")
    index = index.replace("<script ", f'<script nonce="{NONCE}" ')
    return index.replace(LOADER, f'{LOADER}e.nonce="{NONCE}";')


def _with_our_parts(index: str) -> str:
    """Return the page with our layout, keys and pad; these come first, so that the loading step is shown at once."""
    style = "".join((STATIC / name).read_text(encoding="utf-8") for name in STYLES)
    head = f'<style>{style}</style><script nonce="{NONCE}">{_script()}</script></head>'
    body = f"<body>{(STATIC / PARTS).read_text(encoding='utf-8')}"
    return index.replace("<body>", body).replace("</head>", head)


def _script() -> str:
    parts = "\n".join((STATIC / name).read_text(encoding="utf-8") for name in SCRIPTS)
    tables = {
        "KEYMAP": {
            "directions": direction_codes(),
            "actions": action_codes(),
            "everybody": sorted(action for action in Action if action.wish.audience is Audience.EVERYBODY),
            "labels": {action: action.wish.words for action in Action},
            "allDirections": list(Direction),
            "help": help_rows(),
            "caps": us_caps(),
        },
        "LINK_WORDS": LINK_PARAMETERS,
        "COLOURS": _COLOURS,
        "RAMP": palette.PROBABILITY_RAMP.tolist(),
        "SCORE_RAMP": palette.SCORE_RAMP.tolist(),
        "TIMELINE": strip_tables(),
        "GLOSSARY": [term._asdict() for term in TERMS],
        "SOCKET_WORKER": (STATIC / SOCKET_WORKER).read_text(encoding="utf-8"),
    }
    # "<" would let a text end the script element.
    constants = "\n".join(f"const {name} = {json.dumps(table)};" for name, table in tables.items()).replace(
        "<", "\\u003c"
    )
    return f'(() => {{\n"use strict";\n{constants}\n{parts}\n}})();'
