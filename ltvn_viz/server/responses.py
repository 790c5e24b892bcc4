"""HTTP answers of the page's server: each carries the headers that keep other sites out."""

from http import HTTPStatus

from websockets.datastructures import Headers
from websockets.http11 import Response

SECURITY_HEADERS = (
    ("Cache-Control", "no-store"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
)

NOTHING_ALLOWED = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
"""Content policy of everything that is not the page itself."""

TEXT = "text/plain; charset=utf-8"
HTML = "text/html; charset=utf-8"


def reply(
    status: HTTPStatus,
    body: str | bytes,
    *,
    content_type: str = TEXT,
    policy: str = NOTHING_ALLOWED,
    extra: tuple[tuple[str, str], ...] = (),
) -> Response:
    """Return a whole answer with the security headers."""
    content = body.encode() if isinstance(body, str) else body
    headers = Headers(
        [
            ("Content-Type", content_type),
            ("Content-Length", str(len(content))),
            ("Content-Security-Policy", policy),
            *SECURITY_HEADERS,
            *extra,
        ]
    )
    return Response(status.value, status.phrase, headers, content)


def refuse(status: HTTPStatus, text: str) -> Response:
    """Return a refusal that says what to do."""
    return reply(status, text + "\n")
