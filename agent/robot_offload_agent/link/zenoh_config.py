"""Settings of a Zenoh session and, from them, keys and configuration: pure, no session is opened here.

The measurements behind this configuration are in docs/decisions/0002-two-zenoh-sessions.md.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from robot_offload_agent.errors import ConfigurationError

KEY_PREFIX = "robot_offload"
MAX_SESSIONS = 6
"""At the cloud: the one in use and the one for large messages, two that take over from them, and two that ended without
a goodbye and still have their lease, as happens on a path that is cut again and again."""
BULK_BYTES = 1000
"""Header + payload above this do not fit in one QUIC datagram (about 1150 bytes) together with their key."""

_UID = re.compile(r"[A-Za-z0-9._-]{1,63}")
_COMMON_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")  # `*` would be a pattern to the wheel
_CHANNEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*(/[A-Za-z0-9._-]+)*")  # one that begins with _ is the link's own
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^\s\[\]:/?#]+):(\d{1,5})")
_QUEUE_BATCHES = 16  # the wheel's maximum; with the default of 2, 0.1 % is lost on a link that loses nothing
_WAIT_BEFORE_DROP_US = 20_000  # a full queue holds a sender up for no longer than this
_SAID = ["put", "delete"]
_ASKED_FOR = ["declare_subscriber"]
_NEVER_MS = 3_600_000
_POSITIVE = (
    "lease_ms", "open_timeout_ms", "slow_open_timeout_ms", "retry_ms", "fallback_after_ms", "primary_retry_s",
    "backlog_ms",
)  # fmt: skip


@dataclass(frozen=True)
class ZenohSettings:
    """Settings of one side for one of its two sessions.

    Attributes:
        side: `robot` dials, `cloud` listens.
        session: `pulse` (beats, datagrams only) or `data` (streams and datagrams).
        uid: of the RobotOffload; part of every key.
        endpoints: QUIC, `quic/host:port`; the cloud's host is the address to listen on, e.g. 0.0.0.0. Whether
            messages are datagrams or streams is the session's matter: never part of the endpoint.
        ca: PEM file of the authorities that the other side's certificate must come from.
        certificate: PEM file of this side's certificate. Like `ca` and `private_key` it is read whenever a robot
            dials, but by a listener only once: a cloud with new files is started anew.
        private_key: PEM file of its key.
        fallback: TLS over TCP, `tls/host:port`, for networks without UDP; empty for none. The cloud listens on both.
        peer_name: the common name of the other side's certificate. The cloud lets only the sessions of this robot
            send and receive. The robot checks it if `verify_name` is off: the wheel trusts all public
            authorities beside `ca`, so without this check any valid certificate of the internet would pass for the
            cloud. So the cloud's must be a name that no public authority certifies, such as one without a dot.
        verify_name: the cloud's certificate must name the host that the robot dials; otherwise it must carry
            `peer_name`.
        observers: common names of certificates that may listen to everything at the cloud and send nothing; for
            measurements from outside.
        lease_ms: a session that receives nothing for this long ends. Only the end discards stale messages in the
            transport, so it is short: 500 for the pulse, 1000 for data.
        open_timeout_ms: of one attempt to open a session. Opening takes about three round trips.
        slow_open_timeout_ms: of every second attempt if the others have failed for a while, for slow paths; and how
            long the cloud waits for a robot that has begun to connect.
        retry_ms: pause between two attempts; with open_timeout_ms it determines how long after a cut the session is
            back.
        fallback_after_ms: the fallback is tried if two attempts or more in this time got no session, and after
            as long without success again the primary.
        primary_retry_s: how often the primary is tried again while the fallback is in use.
        backlog_ms: bulk (above BULK_BYTES) of a channel is refused while an earlier message of it is on its way
            for longer: a link that carries less than is put into it would deliver everything seconds old.
    """

    side: str
    session: str
    uid: str
    endpoints: tuple[str, ...]
    ca: str
    certificate: str
    private_key: str
    peer_name: str
    fallback: tuple[str, ...] = ()
    verify_name: bool = True
    observers: tuple[str, ...] = ()
    lease_ms: int = 500
    open_timeout_ms: int = 500
    slow_open_timeout_ms: int = 3000
    retry_ms: int = 100
    fallback_after_ms: float = 5000
    primary_retry_s: float = 10.0
    backlog_ms: float = 150

    def __post_init__(self) -> None:
        """Raise ConfigurationError naming the first value that cannot work."""
        if self.side not in ("robot", "cloud"):
            raise ConfigurationError(f"side {self.side!r}: say robot or cloud")
        if self.session not in ("pulse", "data"):
            raise ConfigurationError(f"session {self.session!r}: say pulse or data")
        if not _UID.fullmatch(self.uid):
            raise ConfigurationError(f"uid {self.uid!r}: use 1 to 63 letters, digits, '.', '_' and '-'")
        _check_common_names("peer_name", self.peer_name)
        _check_common_names("observers", *self.observers)
        if not self.endpoints:
            raise ConfigurationError(f"{self.session} endpoints: at least one quic/HOST:PORT is needed")
        for name in _POSITIVE:
            if getattr(self, name) <= 0:
                raise ConfigurationError(f"{name} {getattr(self, name)!r}: must be more than 0")
        for endpoint in self.endpoints:
            _check_endpoint(endpoint, "quic")
        for endpoint in self.fallback:
            _check_endpoint(endpoint, "tls")

    @property
    def dials(self) -> bool:
        """Whether this side opens the connection."""
        return self.side == "robot"

    @property
    def other_side(self) -> str:
        """The side whose keys are subscribed."""
        return "cloud" if self.dials else "robot"


def _check_common_names(parameter: str, *names: str) -> None:
    for name in names:
        if not _COMMON_NAME.fullmatch(name):
            raise ConfigurationError(f"{parameter} {name!r}: give the common name that is in the certificate")


def _check_endpoint(endpoint: str, protocol: str) -> None:
    found, _, address = endpoint.partition("/")
    if found != protocol:
        # A plain udp or tcp listener would admit any client, even beside one that asks for certificates.
        raise ConfigurationError(
            f"endpoint {endpoint!r}: must be {protocol}/HOST:PORT, other protocols are not allowed"
        )
    match = _ADDRESS.fullmatch(address)
    if match is None or not 0 < int(match[2]) < 65536:
        raise ConfigurationError(f"endpoint {endpoint!r}: must be {protocol}/HOST:PORT, IPv6 in brackets")


def key(settings: ZenohSettings, sender_side: str, channel: str) -> str:
    """Return the key under which a side sends a channel.

    Raises:
        ConfigurationError: the channel's name is not a valid key.
    """
    if not _CHANNEL.fullmatch(channel):
        raise ConfigurationError(f"channel {channel!r}: use letters, digits, '.', '_', '-', and '/' between words")
    return _key(settings, sender_side, channel)


def acknowledgement_key(settings: ZenohSettings, sender_side: str) -> str:
    """Return the key under which a side acknowledges bulk."""
    return _key(settings, sender_side, "_ack")


UID_KEY = f"{KEY_PREFIX}/_uid"
"""Under this key a cloud states which uid it serves, to a robot that is silent under that uid."""


def key_prefix(settings: ZenohSettings, sender_side: str) -> str:
    """Return the beginning of all keys under which a side sends in the session."""
    return f"{KEY_PREFIX}/{settings.uid}/{sender_side}/{settings.session}"


def _key(settings: ZenohSettings, sender_side: str, name: str) -> str:
    return f"{key_prefix(settings, sender_side)}/{name}"


def session_config(
    settings: ZenohSettings, *, fallback: bool = False, open_timeout_ms: int | None = None
) -> dict[str, Any]:
    """Return the configuration of a session: the robot's over the primary or the fallback, the cloud's over both.

    `open_timeout_ms` is that of the settings unless given.

    Both sessions carry streams and datagrams on one connection (`mixed_rel`): with datagrams alone (`rel=0`) a lost
    packet may lose the declaration of a subscriber, and then that direction stays silent for the whole session.
    Zenoh neither retries nor reconnects: the link does, because only so every connection is checked and read anew.
    """
    certified = "connect" if settings.dials else "listen"
    config: dict[str, Any] = {
        "access_control": access_control(settings),
        "mode": "client" if settings.dials else "router",
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": []},
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": {
                "open_timeout": open_timeout_ms or settings.open_timeout_ms,
                "accept_timeout": settings.slow_open_timeout_ms,
                "max_links": 1,
                "max_sessions": MAX_SESSIONS + len(settings.observers),
            },
            "link": {
                "protocols": ["quic", "tls"],
                "tx": {"lease": settings.lease_ms, "keep_alive": 4, "queue": _queue()},
                "tls": {
                    "root_ca_certificate": settings.ca,
                    "enable_mtls": True,
                    f"{certified}_certificate": settings.certificate,
                    f"{certified}_private_key": settings.private_key,
                    "verify_name_on_connect": settings.verify_name,
                },
            },
        },
    }
    if settings.dials:
        config["connect"] = {
            "endpoints": list(settings.fallback) if fallback else [f"{e}?mixed_rel=1" for e in settings.endpoints],
            "timeout_ms": 0,
            "exit_on_failure": True,
            "retry": {"period_init_ms": _NEVER_MS, "period_max_ms": _NEVER_MS, "period_increase_factor": 1},
        }
    else:
        listened = [f"{e}?mixed_rel=auto" for e in settings.endpoints]
        config["listen"] = {"endpoints": [*listened, *settings.fallback]}
    return config


def access_control(settings: ZenohSettings) -> dict[str, Any]:
    """Return who may send and receive what in a session; everything else is denied, also queries and liveliness.

    The cloud routes between its clients. Without these rules any holder of a certificate of the robot, such as a copy
    of its bundle, could send to the robot as if it were the cloud, and receive the robot's messages.
    """
    prefix = f"{KEY_PREFIX}/{settings.uid}"

    def allowed(name: str, messages: list[str], flow: str, keys: str) -> dict[str, Any]:
        return {"id": name, "permission": "allow", "messages": messages, "flows": [flow], "key_exprs": [keys]}

    own, others = (f"{prefix}/{side}/{settings.session}/**" for side in (settings.side, settings.other_side))
    peer = [
        allowed("heard", _SAID, "ingress", others),
        allowed("said", _SAID, "egress", own),
        allowed("asked for", _ASKED_FOR, "ingress", own),
        allowed("ask for", _ASKED_FOR, "egress", others),
        allowed("who is served", _SAID, "ingress" if settings.dials else "egress", UID_KEY),
        allowed("who is asked", _ASKED_FOR, "egress" if settings.dials else "ingress", UID_KEY),
    ]
    observer = [
        allowed("shown", _SAID, "egress", f"{prefix}/**"),
        allowed("watched", _ASKED_FOR, "ingress", f"{prefix}/**"),
    ]
    # The robot has one connection, and has checked whose certificate is at its end.
    subjects: list[dict[str, Any]] = [{"id": "peer"} if settings.dials else _named("peer", (settings.peer_name,))]
    rules = {"peer": peer}
    if settings.observers and not settings.dials:
        subjects.append(_named("observer", settings.observers))
        rules["observer"] = observer
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for group in rules.values() for rule in group],
        "subjects": subjects,
        "policies": [{"subjects": [who], "rules": [rule["id"] for rule in group]} for who, group in rules.items()],
    }


def _named(subject: str, names: tuple[str, ...]) -> dict[str, Any]:
    return {"id": subject, "cert_common_names": list(names)}


def _queue() -> dict[str, Any]:
    return {
        "size": dict.fromkeys(("real_time", "data", "data_low", "background"), _QUEUE_BATCHES),
        "congestion_control": {
            "drop": {
                "wait_before_drop": _WAIT_BEFORE_DROP_US,
                "max_wait_before_drop_fragments": _WAIT_BEFORE_DROP_US,
            }
        },
    }
