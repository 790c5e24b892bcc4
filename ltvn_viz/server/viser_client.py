"""viser's own page, and what is mended in it before it is served or exported.

viser keeps its whole application packed in one HTML file, whose loader unpacks it in the browser; so it is mended
there. The version is pinned, and each mend fails loudly where its place is not found.
"""

from pathlib import Path

import viser

_UNPACKED = "const code=td.decode(heap.subarray(up+ss,up+sz));"
"""Where viser's loader has its application as text."""
_WITHOUT_SPLATS = (
    "const code=td.decode(heap.subarray(up+ss,up+sz))"
    r".replace(/\.then\((\w+)=>\w+\(\{wasmBinary:\1\}\)\)(?=;function)/,'.then(()=>new Promise(()=>{}))');"
)
"""The sorter of Gaussian splats, which nothing of ours shows, is set up when the application starts and evaluates text
as code; a policy that allows no such thing stops it with an EvalError. It is left waiting instead."""

_WITHOUT_NOTICE = "<style>#webgl-software-rendering { display: none; }</style></head>"
"""viser's notice that the processor draws never goes, and covers our own words. The page has a line for it."""


def viser_page() -> str:
    """Return the HTML of viser's page, mended."""
    return mended((Path(viser.__file__).parent / "client/build/index.html").read_text(encoding="utf-8"))


def mended(html: str) -> str:
    """Return a page of viser, live or exported, that evaluates no text as code and covers nothing."""
    if html.count(_UNPACKED) != 1 or html.count("</head>") != 1:
        raise RuntimeError(f"viser {viser.__version__} has another page than the one this was written for")
    return html.replace(_UNPACKED, _WITHOUT_SPLATS).replace("</head>", _WITHOUT_NOTICE)
