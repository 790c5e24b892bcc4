"""The connection to the robots of a ROS 2 domain by Zenoh; the only module that imports that library.

Publishes and subscribes as `rmw_zenoh` does, and appears in `ros2 topic list`. A link connects to a router (`connect`),
or is a router itself (`listen`); it opens no other port and does not use multicast discovery. A broken link reconnects
by itself, and messages in the meantime are lost instead of queued. Errors in a robot's messages are logged with a rate
limit per kind, so that the log stays readable.
"""

import json
import logging
import re
import socket
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Self

import zenoh

from ltvn_core.errors import LtvnError, RobotError
from ltvn_core.robots.ros2.topic_keys import (
    BRIDGE_TOKENS,
    NO_HASH,
    Attachment,
    Declared,
    Endpoint,
    Role,
    Topic,
    decode,
    encode,
    node_token,
    token_pattern,
)

_LOG = logging.getLogger(__name__)
_AGAIN_S = 5.0
_CONNECT_MS = 3000
_ADDRESS = re.compile(r"(tcp|tls|quic|udp|ws)/(\[[0-9a-fA-F:]+\]|[A-Za-z0-9.-]+):([0-9]{1,5})")
LOOPBACK = "tcp/127.0.0.1:7447"
"""Default address of a router on this machine."""


class Complaints:
    """Logs errors with a rate limit."""

    def __init__(self) -> None:
        self._said_s: dict[str, float] = {}

    def say(self, error: RobotError) -> None:
        """Log an error, unless the same one was logged in the last 5 seconds; numbers in the text are ignored."""
        kind = re.sub(r"[0-9.]+", "#", str(error))
        now_s = time.monotonic()
        if now_s - self._said_s.get(kind, -_AGAIN_S) >= _AGAIN_S:
            self._said_s[kind] = now_s
            _LOG.warning("%s", error)


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
        self.domain = domain
        self._session = session
        self._node = node
        self._endpoints = 0
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
        endpoint = self._announce(topic, Role.PUBLISHES, best_effort)
        return self._keep(TopicPublisher(_declare_publisher(self._session, topic, topic.key), endpoint))

    def command_publisher(self, topic: Topic) -> "TopicPublisher":
        """Announce a publisher of commands, for robots with any edition of ROS 2.

        Other messages are published only for editions with type hashes, because a subscriber to all keys would receive
        them twice.
        """
        publisher = self.publisher(topic)
        listeners = Listeners(topic, _declare_publisher(self._session, topic, topic.unhashed_key))
        self._keep(self._session.liveliness().declare_subscriber(topic.subscriber_tokens, listeners.take, history=True))
        publisher.listeners = listeners
        return publisher

    def subscribe(self, topic: Topic, take: Callable[[Received], None], refuse: Callable[[RobotError], None]) -> None:
        """Call `take` with each message, and `refuse` with the error of a message that cannot be read.

        Both are called in a thread of the link, one message at a time. A RobotError from `take` also goes to `refuse`.
        """

        def receive(sample: zenoh.Sample) -> None:
            arrived_s = time.monotonic()
            try:
                take(_read(sample, topic, arrived_s))
            except LtvnError as error:
                refuse(error if isinstance(error, RobotError) else RobotError(str(error)))
            except Exception:  # Zenoh would drop the exception silently.
                _LOG.exception("%s: a message could not be handled.", topic.name)

        self._keep(self._session.declare_subscriber(topic.any_type_key, receive))
        self._announce(topic, Role.SUBSCRIBES, best_effort=False)  # A node that sees the token may send at once.

    def publishers(self, name: str) -> list[str]:
        """Return the nodes that announce a publisher of a topic, such as `/odom`."""
        found = self.declared(Role.PUBLISHES)
        return sorted(each.node for each in found if (each.domain, each.name) == (str(self.domain), name))

    def declared(self, role: Role) -> list[Declared]:
        """Return all endpoints of a role, in any domain. Waits up to 1 s; not to be called in a thread of the link."""
        replies = [reply.ok for reply in self._session.liveliness().get(token_pattern(role), timeout=1.0)]
        return [Declared.from_token(str(reply.key_expr)) for reply in replies if reply is not None]

    def hears_dds_bridge(self, names: Iterable[str]) -> bool:
        """Tell whether a zenoh-bridge-ros2dds answers, by its tokens or by messages whose keys are bare topic names.

        Waits up to 2 s; not to be called in a thread of the link.
        """
        if any(reply.ok is not None for reply in self._session.liveliness().get(BRIDGE_TOKENS, timeout=1.0)):
            return True
        heard = threading.Event()
        keys = {f"**/{name.strip('/')}" for name in names}
        listening = [self._session.declare_subscriber(key, lambda _: heard.set()) for key in keys]
        heard.wait(1.0)
        for each in listening:
            each.undeclare()
        return heard.is_set()

    def close(self) -> None:
        """Undeclare everything and disconnect; closing twice is allowed."""
        for each in reversed(self._declared):
            each.undeclare()
        self._declared.clear()
        if not self._session.is_closed():
            self._session.close()

    def _announce(self, topic: Topic, role: Role, best_effort: bool) -> Endpoint:
        self._endpoints += 1
        endpoint = Endpoint(
            session=str(self._session.zid()),
            node=self._node,
            number=self._endpoints,
            role=role,
            topic=topic,
            best_effort=best_effort,
        )
        self._keep(self._session.liveliness().declare_token(endpoint.token))
        return endpoint

    def _keep(self, declared: Any) -> Any:
        self._declared.append(declared)
        return declared


class Listeners:
    """Subscribers to a topic of commands, by their liveliness tokens, and the publisher for those of ROS 2 Humble."""

    def __init__(self, topic: Topic, unhashed: zenoh.Publisher) -> None:
        self._topic = topic
        self._unhashed = unhashed
        self._found: dict[str, Declared] = {}

    def __bool__(self) -> bool:
        """Tell whether any subscriber can read the messages."""
        return any(map(self._topic.fits, self._all))

    @property
    def other_types(self) -> list[str]:
        """The types that other subscribers expect instead."""
        return sorted({each.type_name for each in self._all} - {self._topic.type_name})

    @property
    def _all(self) -> list[Declared]:
        return list(self._found.values())

    def take(self, token: zenoh.Sample) -> None:
        """Register that a subscriber appeared or disappeared."""
        key = str(token.key_expr)
        if token.kind == zenoh.SampleKind.DELETE:
            self._found.pop(key, None)
        else:
            self._found[key] = Declared.from_token(key)

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Send a message if there is any subscriber of ROS 2 Humble."""
        if any(each.edition == NO_HASH and self._topic.fits(each) for each in self._all):
            self._unhashed.put(payload, attachment=attachment)

    def undeclare(self) -> None:
        """Withdraw the publisher."""
        self._unhashed.undeclare()


class TopicPublisher:
    """Sends messages of one topic, with a sequence number and its id. May be used from any thread."""

    listeners: Listeners | None = None
    """Subscribers to commands; None for other messages."""

    def __init__(self, publisher: zenoh.Publisher, endpoint: Endpoint) -> None:
        self._publisher = publisher
        self._gid = endpoint.gid
        self._sequence = 0
        self._is_open = True
        self._lock = threading.Lock()

    @property
    def has_listener(self) -> bool:
        """Whether the topic has a subscriber now; for commands, one that declares their type."""
        if self.listeners is not None:
            return bool(self.listeners)
        with self._lock:
            status: Any = self._publisher.matching_status if self._is_open else None  # The stub declares bool.
            return status is not None and bool(status.matching)

    def put(self, message: Any) -> None:
        """Send a message now, or drop it if the link is closed, broken or full; a message that waits would be
        outdated."""
        payload = encode(message)
        with self._lock:
            if not self._is_open:
                return
            self._sequence += 1
            attachment = Attachment(self._sequence, time.time_ns(), self._gid).to_bytes()
            self._publisher.put(payload, attachment=attachment)
            if self.listeners is not None:
                self.listeners.put(payload, attachment)

    def undeclare(self) -> None:
        """Withdraw the publisher; waits for a message that another thread is sending."""
        with self._lock:
            self._is_open = False
            self._publisher.undeclare()
            if self.listeners is not None:
                self.listeners.undeclare()


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


def _read(sample: zenoh.Sample, topic: Topic, arrived_s: float) -> Received:
    """Check and decode a message. Raises RobotError."""
    topic.check_key(str(sample.key_expr))
    beside = None if sample.attachment is None else sample.attachment.to_bytes()
    attachment = Attachment.from_bytes(beside, topic.name)
    return Received(decode(sample.payload.to_bytes(), topic.type_name, topic.name), attachment, arrived_s)
