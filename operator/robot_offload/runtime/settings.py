"""The operator's settings, from its environment; read once, at the start."""

from __future__ import annotations

import datetime
import ipaddress
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from robot_offload.api.v1alpha1.pod_spec import check_pod_spec
from robot_offload.controller.tools import Policy
from robot_offload.decide.authorities import KEEP
from robot_offload.decide.rollouts import AT_ONCE
from robot_offload.errors import InputError
from robot_offload.objects.facts import BUILDER, Images, Network

LogFormat: TypeAlias = Literal["json", "text"]
_LEVELS: Final = ("debug", "info", "warning", "error")
_FORMATS: Final[Mapping[str, LogFormat]] = {"json": "json", "text": "text"}


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings of one operator. Times in seconds.

    Attributes:
        images: of our own programs.
        watch_namespaces: the namespaces that it serves; empty: all.
        pod_namespace: of the leader's Lease.
        pod_name: its identity as leader; unique among operators.
        resync_s: period in which every object is looked at, regardless of events.
        probe_s: period in which the watch is compared with a list.
        inactivity_s: a watch that is silent for this long is reopened.
        lease_s: duration of the leader's Lease.
        metrics_port: of /metrics; 0: a free one, named in the log.
        health_port: of /livez and /readyz; 0: a free one, named in the log.
        log_level: debug, info, warning or error.
        log_format: json, one object a line, or text for people.
        request_s: time limit of one request to the API server.
        workers: how many objects are processed concurrently.
        max_rolling: number of robots whose pods are replaced at once when the operator itself wants other pods.
        load_balancer_node_ports: whether Services of type LoadBalancer get node ports, too.
        network: decisions about network policies.
        pull_secrets: names of Secrets for pulling the images of all robots.
        pod_spec: defaults for the pods of all robots.
        keep: how long the keys of authorities outlive their RobotOffload.
        admission: the name of the admission policy; empty: objects are not checked again.
    """

    images: Images
    pod_namespace: str
    pod_name: str
    watch_namespaces: tuple[str, ...] = ()
    resync_s: float = 300.0
    probe_s: float = 30.0
    inactivity_s: float = 70.0
    lease_s: float = 15.0
    metrics_port: int = 8080
    health_port: int = 8081
    log_level: str = "info"
    log_format: LogFormat = "json"
    request_s: float = 15.0
    workers: int = 4
    max_rolling: int = AT_ONCE
    load_balancer_node_ports: bool = True
    network: Network = field(default_factory=Network)
    pull_secrets: tuple[str, ...] = ()
    pod_spec: Mapping[str, Any] = field(default_factory=dict)
    admission: str = ""
    keep: datetime.timedelta = KEEP

    @property
    def policy(self) -> Policy:
        """Return the part that applies to all RobotOffloads."""
        return Policy(
            max_rolling=self.max_rolling,
            load_balancer_node_ports=self.load_balancer_node_ports,
            network=self.network,
            home=self.pod_namespace,
            adopt=bool(self.keep),
            pull_secrets=self.pull_secrets,
            pod_spec=self.pod_spec,
            admission=self.admission,
        )


def from_environment(environment: Mapping[str, str]) -> Settings:
    """Read the settings from an environment.

    Raises:
        InputError: variables are missing or have no usable value; all are reported.
    """
    problems: list[str] = []

    def text(name: str) -> str:
        value = environment.get(name, "")
        if not value:
            problems.append(f"{name} is not set")
        return value

    def number(name: str, default: float, lowest: float) -> float:
        value = environment.get(name) or str(default)
        try:
            found = float(value)
        except ValueError:
            problems.append(f"{name} must be a number, found {value!r}")
            return default
        if found < lowest:
            problems.append(f"{name} must be at least {lowest:g}, found {value}")
        return found

    settings = Settings(
        images=Images(
            agent=text("AGENT_IMAGE"),
            operator=text("OPERATOR_IMAGE"),
            discovery=text("DISCOVERY_IMAGE"),
            router=text("ROUTER_IMAGE"),
            git=environment.get("GIT_IMAGE", ""),
            builder=environment.get("BUILDER_IMAGE") or BUILDER,
        ),
        pod_namespace=text("POD_NAMESPACE"),
        pod_name=text("POD_NAME"),
        watch_namespaces=_words(environment.get("WATCH_NAMESPACE", "")),
        resync_s=number("RESYNC_SECONDS", 300.0, 1.0),
        probe_s=number("PROBE_SECONDS", 30.0, 0.5),
        inactivity_s=number("WATCH_INACTIVITY_SECONDS", 70.0, 1.0),
        lease_s=number("LEADER_LEASE_SECONDS", 15.0, 3.0),
        metrics_port=int(number("METRICS_PORT", 8080, 0)),
        health_port=int(number("HEALTH_PORT", 8081, 0)),
        log_level=_one_of("LOG_LEVEL", environment.get("LOG_LEVEL") or "info", _LEVELS, problems),
        log_format=_FORMATS.get(
            _one_of("LOG_FORMAT", environment.get("LOG_FORMAT") or "json", _FORMATS, problems), "json"
        ),
        request_s=number("REQUEST_TIMEOUT_SECONDS", 15.0, 0.1),
        workers=int(number("WORKERS", 4, 1)),
        pull_secrets=_words(environment.get("ROBOT_PULL_SECRETS", "")),
        pod_spec=_pod_spec("ROBOT_POD_SPEC", environment, problems),
        keep=datetime.timedelta(days=number("AUTHORITY_KEEP_DAYS", KEEP.days, 0)),
        admission=environment.get("ADMISSION_POLICY", ""),
        max_rolling=int(number("MAX_ROLLING", AT_ONCE, 1)),
        load_balancer_node_ports=_truth("LOAD_BALANCER_NODE_PORTS", environment, problems),
        network=Network(
            policies=_truth("NETWORK_POLICIES", environment, problems),
            dns=_networks("DNS_NETWORKS", environment, problems),
            api_server=_networks("API_SERVER_NETWORKS", environment, problems),
            metrics_from=_words(environment.get("METRICS_NAMESPACES", "")),
            api_server_from=_networks("API_SERVER_SOURCES", environment, problems),
        ),
    )
    if problems:
        raise InputError("\n".join(problems))
    return settings


def _words(text: str) -> tuple[str, ...]:
    """Return the words of a comma-separated list, each once."""
    return tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))


def _one_of(name: str, text: str, allowed: Collection[str], problems: list[str]) -> str:
    word, words = text.lower(), list(allowed)
    if word not in words:
        problems.append(f"{name} must be {', '.join(words[:-1])} or {words[-1]}, found {text!r}")
    return word


def _format(text: str, problems: list[str]) -> LogFormat:
    return _FORMATS.get(_one_of("LOG_FORMAT", text, _FORMATS, problems), "json")


def _networks(name: str, environment: Mapping[str, str], problems: list[str]) -> tuple[str, ...]:
    found = _words(environment.get(name, ""))
    for word in found:
        try:
            ipaddress.ip_network(word)
        except ValueError as error:
            problems.append(f"{name} must be networks such as 10.96.0.10/32, separated by commas: {error}")
    return found


def _pod_spec(name: str, environment: Mapping[str, str], problems: list[str]) -> Mapping[str, Any]:
    try:
        found: Mapping[str, Any] = check_pod_spec(json.loads(environment.get(name) or "{}"))
    except ValueError as error:
        problems.append(f"{name}: {error}")
        return {}
    return found


def _truth(name: str, environment: Mapping[str, str], problems: list[str]) -> bool:
    text = (environment.get(name) or "true").lower()
    if text not in ("true", "false"):
        problems.append(f"{name} must be true or false, found {text!r}")
    return text == "true"
