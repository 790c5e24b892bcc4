"""The connection to the robots of a ROS 2 domain by Zenoh; the only module that imports that library.

Publishes and subscribes as `rmw_zenoh` does, and appears in `ros2 topic list`. A link connects to a router (`connect`),
or is a router itself (`listen`); it opens no other port and does not use multicast discovery. A broken link reconnects
by itself, and messages in the meantime are lost instead of queued. Errors in a robot's messages are logged with a rate
limit per kind, so that the log stays readable.
"""

import hashlib
import json
import logging
import math
import re
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Self

import zenoh

from ltvn_core.errors import LtvnError, RobotError
from ltvn_core.robots.ros2.topic_keys import (
    GID_BYTES,
    NO_HASH,
    Attachment,
    Role,
    Topic,
    decode,
    encode,
    endpoint_tokens,
    node_token,
)

_LOG = logging.getLogger(__name__)
_AGAIN_S = 5.0
_CONNECT_MS = 3000
_ADDRESS = re.compile(r"(tcp|tls|quic|udp|ws)/(\[[0-9a-fA-F:]+\]|[A-Za-z0-9.-]+):([0-9]{1,5})")
LOOPBACK = "tcp/127.0.0.1:7447"
"""Default address of a router on this machine."""


class Received(NamedTuple):
    """A message that arrived and was decoded."""

    message: Any
    attachment: Attachment
    arrived_s: float
    """Time of arrival, in seconds on this machine's monotonic clock (`time.monotonic`)."""


class ZenohLink:
    """One node in a ROS 2 domain. A context manager; closing it removes the node from the others' lists."""

    def __init__(self, session: zenoh.Session, node: str, domain: int, address: str) -> None:
        """Called by `connect` and `listen`."""
        self.address = address
        """Address of the router."""
        self._domain = domain
        self._session = session
        self._node = node
        self._endpoints = 0
        self._said_s: dict[str, float] = {}
        self._declared: list[Any] = [session.liveliness().declare_token(node_token(str(session.zid()), node, domain))]

    @classmethod
    def connect(cls, address: str, *, node: str, domain: int = 0) -> Self:
        """Connect to the router at `address`, such as tcp/127.0.0.1:7447. Raises RobotError."""
        check_address(address)
        settings = {"mode": "client", "connect/endpoints": [address], "connect/timeout_ms": _CONNECT_MS}
        advice = "is the router running (`ros2 run rmw_zenoh_cpp rmw_zenohd`, or `ltvn serve`), and the port open?"
        return cls(_open(settings, f"No router answers at {address}; {advice}"), node, domain, address)

    @classmethod
    def listen(cls, address: str, *, node: str, domain: int = 0) -> Self:
        """Be a router at `address`; port 0 chooses a free port. Raises RobotError if the port is taken."""
        address = _with_port(address)
        settings = {"mode": "router", "listen/endpoints": [address]}
        advice = "another router may be there; use --connect instead, or another port."
        return cls(_open(settings, f"Cannot listen at {address}; {advice}"), node, domain, address)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_connected(self) -> bool:
        """Whether the link is connected now."""
        return any(True for _ in self._session.info.transports())

    def publisher(self, topic: Topic, *, best_effort: bool = False) -> "TopicPublisher":
        """Announce a publisher of a topic."""
        token = self._announce(topic, Role.PUBLISHES, best_effort)
        return self._keep(TopicPublisher(self._session, topic, token))

    def command_publisher(self, topic: Topic) -> "CommandPublisher":
        """Announce a publisher of commands."""
        token = self._announce(topic, Role.PUBLISHES, best_effort=False)
        return self._keep(CommandPublisher(self._session, topic, token))

    def subscribe(
        self,
        topic: Topic,
        take: Callable[[Received], None],
        refuse: Callable[[RobotError], None] = lambda error: None,
    ) -> None:
        """Call `take` with each message, and `refuse` with the error of a message that cannot be read or taken.

        Both are called in a thread of the link, one message at a time. Errors are logged too.
        """

        def receive(sample: zenoh.Sample) -> None:
            arrived_s = time.monotonic()
            try:
                topic.check_key(str(sample.key_expr))
                beside = None if sample.attachment is None else sample.attachment.to_bytes()
                attachment = Attachment.from_bytes(beside, topic.name)
                take(Received(decode(sample.payload.to_bytes(), topic.type_name, topic.name), attachment, arrived_s))
            except LtvnError as error:
                refused = error if isinstance(error, RobotError) else RobotError(str(error))
                refuse(refused)
                self.complain(refused)
            except Exception:  # Zenoh would drop the exception silently.
                _LOG.exception("%s: a message could not be handled.", topic.name)

        self._keep(self._session.declare_subscriber(topic.any_type_key, receive))
        self._announce(topic, Role.SUBSCRIBES, best_effort=False)  # A node that sees the token may send at once.

    def complain(self, error: RobotError) -> None:
        """Log an error, unless the same one was logged in the last 5 seconds; numbers in the text are ignored."""
        kind = re.sub(r"[0-9.]+", "#", str(error))
        now_s = time.monotonic()
        if now_s - self._said_s.get(kind, -math.inf) >= _AGAIN_S:
            self._said_s[kind] = now_s
            _LOG.warning("%s", error)

    def publishers(self, name: str) -> list[str]:
        """Return the nodes that announce a publisher of a topic, such as `/odom`. Waits up to 1 s; not to be called in
        a thread of the link."""
        tokens = endpoint_tokens(Role.PUBLISHES, self._domain, name)
        replies = [reply.ok for reply in self._session.liveliness().get(tokens, timeout=1.0)]
        return sorted(str(reply.key_expr).split("/")[8] for reply in replies if reply is not None)

    def close(self) -> None:
        """Undeclare everything and disconnect; closing twice is allowed."""
        for each in reversed(self._declared):
            each.undeclare()
        self._declared.clear()
        if not self._session.is_closed():
            self._session.close()

    def _announce(self, topic: Topic, role: Role, best_effort: bool) -> str:
        """Declare the liveliness token of a new endpoint, and return it."""
        self._endpoints += 1
        session = str(self._session.zid())
        token = topic.token(role, session=session, node=self._node, number=self._endpoints, best_effort=best_effort)
        self._keep(self._session.liveliness().declare_token(token))
        return token

    def _keep(self, declared: Any) -> Any:
        self._declared.append(declared)
        return declared


class TopicPublisher:
    """Sends messages of one topic, with a sequence number and its id. May be used from any thread."""

    def __init__(self, session: zenoh.Session, topic: Topic, token: str) -> None:
        self._gid = hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()
        self._sequence = 0
        self._lock = threading.Lock()
        self._publisher: zenoh.Publisher | None = _declare_publisher(session, topic, topic.key)

    @property
    def has_listener(self) -> bool:
        """Whether the topic has a subscriber now."""
        with self._lock:
            status: Any = None if self._publisher is None else self._publisher.matching_status  # Not bool.
            return status is not None and bool(status.matching)

    def put(self, message: Any) -> None:
        """Send a message now, or drop it if the link is closed, broken or full; a message that waits would be
        outdated."""
        payload = encode(message)
        with self._lock:
            if self._publisher is not None:
                self._sequence += 1
                attachment = Attachment(self._sequence, time.time_ns(), self._gid).to_bytes()
                self._publisher.put(payload, attachment=attachment)
                self._put_unhashed(payload, attachment)

    def _put_unhashed(self, payload: bytes, attachment: bytes) -> None:
        """Send a message to robots of ROS 2 Humble; only commands are."""

    def undeclare(self) -> None:
        """Withdraw the publisher; waits for a message that another thread is sending."""
        with self._lock:
            if self._publisher is not None:
                self._publisher.undeclare()
                self._publisher = None


class CommandPublisher(TopicPublisher):
    """Sends commands to robots with any edition of ROS 2; knows their subscribers by their liveliness tokens.

    Other messages are sent only to editions with type hashes, because a subscriber to all keys would get them twice.
    """

    def __init__(self, session: zenoh.Session, topic: Topic, token: str) -> None:
        super().__init__(session, topic, token)
        self._topic = topic
        self._editions: dict[str, str] = {}
        self._unhashed = _declare_publisher(session, topic, topic.unhashed_key)
        tokens = endpoint_tokens(Role.SUBSCRIBES, topic.domain, topic.name)
        self._tokens = session.liveliness().declare_subscriber(tokens, self._take, history=True)

    @property
    def has_listener(self) -> bool:
        """Whether a subscriber can read the commands."""
        return bool(self._editions)

    def _take(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        edition = self._topic.edition_of(token)
        if sample.kind == zenoh.SampleKind.DELETE:
            self._editions.pop(token, None)
        elif edition is not None:
            self._editions[token] = edition

    def _put_unhashed(self, payload: bytes, attachment: bytes) -> None:
        if NO_HASH in list(self._editions.values()):
            self._unhashed.put(payload, attachment=attachment)

    def undeclare(self) -> None:
        """Withdraw the publishers."""
        super().undeclare()
        with self._lock:
            self._tokens.undeclare()
            self._unhashed.undeclare()


def check_address(address: str) -> tuple[str, str, int]:
    """Return protocol, host and port of an address. Raises RobotError if it is invalid."""
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found[3]) > 65535:
        raise RobotError(f"{address!r:.80} is not an address of a router; write tcp/HOST:PORT, as in {LOOPBACK}.")
    return found[1], found[2], int(found[3])


def _with_port(address: str) -> str:
    protocol, host, port = check_address(address)
    if port:
        return address
    with socket.create_server((host.strip("[]"), 0), family=socket.AF_INET6 if "[" in host else socket.AF_INET) as free:
        return f"{protocol}/{host}:{free.getsockname()[1]}"


def _open(settings: dict[str, Any], failure: str) -> zenoh.Session:
    """Open a session with these settings and without discovery. Raises RobotError."""
    config = zenoh.Config()
    quiet = {"scouting/multicast/enabled": False, "listen/endpoints": [], "connect/endpoints": []}
    for key, value in {**quiet, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise RobotError(failure) from error


def _declare_publisher(session: zenoh.Session, topic: Topic, key: str) -> zenoh.Publisher:
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.INTERACTIVE_HIGH if "Twist" in topic.type_name else zenoh.Priority.DATA,
        express=True,
    )
