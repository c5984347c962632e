"""Dashboards and alerts against a real Prometheus that reads the reporter and the operator of a live run.

Prometheus and promtool are built once from Go modules (some two minutes on two cores), kept as the test cluster's
programs are. The run has a node with state and an action, goals, late messages, a build that fails and an object whose
namespace admits nothing: every query of every panel and of every alert has data in the run.
"""

from __future__ import annotations

import json
import re
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode
from urllib.request import urlopen

import pytest
import yaml

from robot_offload_lab.cluster import directories, programs
from robot_offload_lab.cluster.control_plane import ControlPlane
from robot_offload_lab.cluster.definitions import definitions
from robot_offload_lab.cluster.errors import NoGoError
from robot_offload_lab.cluster.pretended_kubelet import report_ended
from tests.integration.chart import ROOT, of_kind, rendered
from tests.integration.operator_cluster import Place
from tests.integration.operator_process import Operator
from tests.integration.resources import talker
from tests.integration.test_operator_builds import built, the_job
from tests.lacking import lacks
from tests.ros.agent.clients import SUCCEEDED, Goal, action_client
from tests.ros.agent.harness import Plan, World
from tests.ros.agent.test_state import PROGRAM as STATEFUL
from tests.ros.ports import free_port
from tests.unit.operator.reporter.running import Running, eventually

pytestmark = [
    pytest.mark.ros,
    pytest.mark.timeout(1500),
    pytest.mark.filterwarnings("ignore:module 'sre_.*' is deprecated:DeprecationWarning"),
]
NAMESPACE, ROBOT = "ward", "talker"
STATE = {
    "states": ["walker_1"],
    "state.walker_1.node": "walker",
    "state.walker_1.kind": "Snapshot",
    "state.walker_1.max_age_ms": 500.0,
    "state.walker_1.max_size": 1024,
}
LATE_MS = 400
"""Longer than the cloud's lease: what the cloud sends to its end arrives when the robot acts, and is refused."""
NARROW, BUILT = "narrow", "built"
POLICY = "statuses-stay"
FORBIDDING: tuple[dict[str, Any], ...] = (
    {
        "apiVersion": "admissionregistration.k8s.io/v1",
        "kind": "ValidatingAdmissionPolicy",
        "metadata": {"name": POLICY},
        "spec": {
            "matchConstraints": {
                "namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": NARROW}},
                "resourceRules": [
                    {
                        "apiGroups": ["robotoffload.dev"],
                        "apiVersions": ["*"],
                        "resources": ["robotoffloads/status"],
                        "operations": ["UPDATE"],
                    }
                ],
            },
            "validations": [{"expression": "false", "message": "nobody writes a status here"}],
        },
    },
    {
        "apiVersion": "admissionregistration.k8s.io/v1",
        "kind": "ValidatingAdmissionPolicyBinding",
        "metadata": {"name": POLICY},
        "spec": {"policyName": POLICY, "validationActions": ["Deny"]},
    },
)
"""A rule of the cluster's by which passes over the objects of one namespace fail."""
PATIENCE_S = 60.0
VARIABLES = {"$__rate_interval": "10s", "$__range": "60s", "$namespace": NAMESPACE, "$robot": ROBOT}


@pytest.fixture(scope="module")
def tools() -> programs.Programs:
    """Prometheus and promtool."""
    try:
        return programs.ensure(print, programs.PROMETHEUS, programs.PROMETHEUS_MODULE)
    except NoGoError as error:
        lacks(str(error))


@pytest.fixture(scope="module")
def plane(tools: programs.Programs) -> Iterator[ControlPlane]:
    built = programs.ensure(print)
    with directories.of_this_run() as directory, ControlPlane(directory, built).running(definitions()) as plane:
        yield plane


@pytest.fixture(scope="module")
def chart(plane: ControlPlane) -> list[dict[str, Any]]:
    """What helm makes of the chart with dashboards and alerts."""
    values = {
        "metrics.dashboards.enabled": True,
        "metrics.dashboards.folder": "Robots",
        "metrics.dashboards.namespace": "monitoring",
        "metrics.alerts.enabled": True,
        "metrics.alerts.runbooks": "https://wiki.example/alerts",
    }
    return rendered(plane.helm("default"), values)


@dataclass
class Prometheus:
    """The running server."""

    url: str

    def ask(self, query: str) -> list[dict[str, Any]]:
        """The series that a query has now; an error of the query fails the test with its text."""
        with urlopen(f"{self.url}/api/v1/query?{urlencode({'query': query})}", timeout=PATIENCE_S) as answer:
            found: list[dict[str, Any]] = json.load(answer)["data"]["result"]
        return found


@pytest.fixture(scope="module")
def prometheus(
    tools: programs.Programs, plane: ControlPlane, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Prometheus]:
    """Prometheus beside both agents, the reporter and the operator; the sides have changed twice."""
    folder = tmp_path_factory.mktemp("prometheus")
    for name in (NAMESPACE, NARROW, BUILT):
        plane.kubectl().apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": name}})
    for rule in FORBIDDING:
        plane.kubectl().apply(rule)
    plane.kubectl(NAMESPACE).apply({**talker(), "metadata": {"name": ROBOT, "namespace": NAMESPACE}})
    plane.kubectl(BUILT).apply({**built(), "metadata": {"name": "walker", "namespace": BUILT}})
    operator = Operator.start(plane.kubeconfig, folder / "operator.log")
    bundled = {"generation": 1}
    plan = Plan(domains=(221, 222), files=True, serves=True, program=STATEFUL, robot=bundled, cloud=bundled, both=STATE)
    with World(plan) as world:
        reporter = Running(folder, plane.kubeconfig, NAMESPACE, ROBOT, STATE_FILE=str(world.folder / "state.file"))
        server = None
        try:
            operator.wait_said("Became leader")
            scraped = operator.wait_said("Serving", what="metrics")["port"]
            port = free_port()
            server = started(tools, folder, port, reporter.port, int(scraped))
            found = Prometheus(f"http://127.0.0.1:{port}")
            world.start()
            # A rule of the cluster's needs a second until it holds.
            plane.kubectl(NARROW).apply({**talker(), "metadata": {"name": ROBOT, "namespace": NARROW}})
            job = the_job(Place(plane, BUILT))
            report_ended(plane, BUILT, job, {"fetch": "fatal: no such branch\n"}, failing="fetch")
            live(world)
            eventually(lambda: answers(found, "count(robot_offload_changeovers_total) > 1"))
            eventually(lambda: answers(found, "robot_offload_info"))
            yield found
        finally:
            if server is not None:
                server.terminate()
                server.wait(30)
            reporter.stop()
            operator.stop()


def live(world: World) -> None:
    """Goals, changes by hand, and a link so late that the robot takes over and refuses what comes then."""
    world.goes_to("cloud")
    client = action_client(world.ear.node, "/count")
    world.place("robot", stay=True)
    assert Goal(client, 3).accepted().result()[0] == SUCCEEDED
    world.place("cloud")
    assert world.wire is not None
    world.wire.set(delay_ms=LATE_MS)
    world.goes_to("robot")
    world.wire.set(delay_ms=0)
    world.goes_to("cloud")
    client.destroy()


def started(tools: programs.Programs, folder: Path, port: int, reporter: int, operator: int) -> subprocess.Popen[bytes]:
    """Prometheus with two targets, labelled as the chart's monitors label them."""
    agents = {"namespace": NAMESPACE, "app_kubernetes_io_instance": ROBOT, "pod": "agent"}
    jobs = [("agents", reporter, agents, False), ("operator", operator, {"namespace": "system"}, True)]
    config = {
        "global": {"scrape_interval": "1s", "scrape_timeout": "1s"},
        "scrape_configs": [
            {
                "job_name": name,
                "honor_labels": honor,
                "static_configs": [{"targets": [f"127.0.0.1:{target}"], "labels": labels}],
            }
            for name, target, labels, honor in jobs
        ],
    }
    file = folder / "prometheus.yaml"
    file.write_text(yaml.safe_dump(config))
    command = [
        str(tools.path("prometheus")), f"--config.file={file}", f"--storage.tsdb.path={folder / 'data'}",
        f"--web.listen-address=127.0.0.1:{port}",
    ]  # fmt: skip
    with (folder / "prometheus.log").open("wb") as log:
        return subprocess.Popen(command, stdout=log, stderr=log)


def answers(prometheus: Prometheus, query: str) -> bool:
    """Whether a query has data; not yet while Prometheus starts."""
    try:
        return bool(prometheus.ask(query))
    except OSError:
        return False


def has_data(prometheus: Prometheus, query: str) -> bool:
    """Whether a query has data within the patience of the test."""
    end = time.monotonic() + PATIENCE_S
    while not answers(prometheus, query):
        if time.monotonic() > end:
            return False
        time.sleep(1)
    return True


def panels(chart: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """(title, query) of every panel, with the variables filled in."""
    found = []
    for board in boards(chart):
        for panel in board["panels"]:
            for target in panel["targets"]:
                query = target["expr"]
                for name, value in VARIABLES.items():
                    query = query.replace(name, value)
                found.append((f"{board['title']}: {panel['title']}", query))
    return found


def boards(chart: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The dashboards in the ConfigMaps."""
    maps = [
        each
        for each in of_kind(chart, "ConfigMap")
        if each["metadata"]["name"].rpartition("-")[0].endswith("dashboard")
    ]
    assert len(maps) == 2
    for each in maps:
        assert each["metadata"]["namespace"] == "monitoring"
        assert each["metadata"]["labels"]["grafana_dashboard"] == "1"
        assert each["metadata"]["annotations"] == {"grafana_folder": "Robots"}
    return [json.loads(text) for each in maps for name, text in each["data"].items() if name.endswith(".json")]


def rules(chart: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The alerts of the PrometheusRule."""
    [found] = of_kind(chart, "PrometheusRule")
    alerts: list[dict[str, Any]] = found["spec"]["groups"][0]["rules"]
    return alerts


def names(query: str) -> set[str]:
    """The metrics that a query reads."""
    return set(re.findall(r"robot_offload_[a-z_]+", query))


def test_every_panel_has_data_in_a_live_run(prometheus: Prometheus, chart: list[dict[str, Any]]) -> None:
    wanted = {query: title for title, query in panels(chart)}

    def silent() -> dict[str, str]:
        return {title: query for query, title in wanted.items() if not answers(prometheus, query)}

    end = time.monotonic() + PATIENCE_S
    while silent() and time.monotonic() < end:
        time.sleep(1)
    assert silent() == {}
    assert len(wanted) > 30


@pytest.mark.parametrize(
    ("query", "why"),
    [
        ('robot_offload_builds{reason="BuildFailed"} == 1', "a build failed"),
        ('robot_offload_goals_total{action="/count", outcome="succeeded"} >= 1', "a goal came to its end"),
        ("robot_offload_state_age_at_change_seconds < 60", "a state was handed on"),
        ("sum(robot_offload_refused_messages_total) > 0", "messages came too late"),
        ("sum(robot_offload_errors_total) > 0", "a pass fails"),
    ],
)
def test_what_happened_in_the_run_is_in_its_numbers(prometheus: Prometheus, query: str, why: str) -> None:
    assert has_data(prometheus, query), f"{why}: {prometheus.ask(min(names(query)))}"


def test_both_sides_numbers_reach_prometheus(prometheus: Prometheus) -> None:
    for name in ("robot_offload_link_latency_seconds_count", "robot_offload_process_cpu_seconds_total"):
        eventually(lambda name=name: {one["metric"]["side"] for one in prometheus.ask(name)} == {"robot", "cloud"})  # type: ignore[misc]
    named = {(one["metric"]["namespace"], one["metric"]["name"]) for one in prometheus.ask("robot_offload_info")}
    assert (NAMESPACE, ROBOT) in named, "an object has the robot's namespace, not the operator's"


def test_every_alert_asks_for_what_is_there(prometheus: Prometheus, chart: list[dict[str, Any]]) -> None:
    for rule in rules(chart):
        prometheus.ask(rule["expr"])
        for name in names(rule["expr"]):
            assert has_data(prometheus, name), rule["alert"]


def test_every_alert_has_a_section_in_its_runbook(chart: list[dict[str, Any]]) -> None:
    page = (ROOT / "docs" / "how-to" / "alerts.md").read_text()
    for rule in rules(chart):
        assert rule["annotations"]["runbook_url"] == f"https://wiki.example/alerts#{rule['alert'].lower()}"
        assert f"\n## {rule['alert']}\n" in page
    assert page.count("\n## RobotOffload") == len(rules(chart))


ONE = {"namespace": NAMESPACE, "app_kubernetes_io_instance": ROBOT}
FIRES: dict[str, tuple[dict[str, str], dict[str, str]]] = {
    "RobotOffloadNoLeader": ({"robot_offload_leader": "0x120"}, {}),
    "RobotOffloadOperatorLate": ({"robot_offload_leader": "1x120", "robot_offload_queue_late_seconds": "300x120"}, {}),
    "RobotOffloadCertificateEnding": (
        {'robot_offload_certificate_expiration_timestamp_seconds{holder="robot"}': "86400x120"}, {"holder": "robot"}
    ),
    "RobotOffloadCertificateNotCurrent": (
        {'robot_offload_condition{type="CertificateCurrent",status="False"}': "1x120"},
        {"type": "CertificateCurrent", "status": "False"},
    ),
    "RobotOffloadStalled": (
        {'robot_offload_condition{type="Stalled",status="True"}': "1x120"}, {"type": "Stalled", "status": "True"}
    ),
    "RobotOffloadNotApplied": (
        {'robot_offload_condition{type="ResourcesApplied",status="False"}': "1x120"},
        {"type": "ResourcesApplied", "status": "False"},
    ),
    "RobotOffloadNotReady": ({'robot_offload_info{ready="False"}': "1x120"}, {"ready": "False"}),
    "RobotOffloadAgentSilent": ({"robot_offload_agent_alive": "0x120"}, {}),
    "RobotOffloadBuildFailed": ({'robot_offload_builds{reason="BuildFailed"}': "1x120"}, {"reason": "BuildFailed"}),
    "RobotOffloadNumbersMissing": (
        {"robot_offload_robot_connected": "1x120", "robot_offload_robot_report": "0x120"}, {}
    ),
    "RobotOffloadFlapping": (
        {'robot_offload_changeovers_total{namespace="ward",app_kubernetes_io_instance="talker"}': "0+5x120"}, ONE
    ),
    "RobotOffloadFalseAlarms": ({"robot_offload_false_alarms_total": "0+1x120"}, {}),
    "RobotOffloadCommandsOverdue": ({'robot_offload_command_overdue_seconds_total{output="a"}': "0+6x120"},
                                    {"output": "a"}),
    "RobotOffloadProcessDying": ({'robot_offload_process_deaths_total{process="data"}': "0+1x120"},
                                {"process": "data"}),
    "RobotOffloadLeaseNotWritten": ({"robot_offload_lease_failures_total": "0+6x120"}, {}),
}  # fmt: skip
"""What makes each alert fire, one value a minute, and the labels that it then has."""
QUIET = {
    "robot_offload_leader": "1x120", "robot_offload_queue_late_seconds": "1x120",
    'robot_offload_certificate_expiration_timestamp_seconds{holder="robot"}': "8000000x120",
    'robot_offload_condition{type="Stalled",status="True"}': "0x120", 'robot_offload_info{ready="True"}': "1x120",
    "robot_offload_agent_alive": "1x120", "robot_offload_robot_connected": "1x120",
    "robot_offload_robot_report": "1x120", "robot_offload_changeovers_total": "0+1x120",
    "robot_offload_false_alarms_total": "0x120", 'robot_offload_command_overdue_seconds_total{output="a"}': "0+1x120",
    'robot_offload_process_deaths_total{process="data"}': "1x120", "robot_offload_lease_failures_total": "3x120",
}  # fmt: skip
"""A day like any other."""


def test_promtool_accepts_the_rules_and_each_fires_when_it_should_and_only_then(
    tools: programs.Programs, chart: list[dict[str, Any]], tmp_path: Path
) -> None:
    alerts = rules(chart)
    assert {rule["alert"] for rule in alerts} == FIRES.keys()
    whole, bare = tmp_path / "rules.yaml", tmp_path / "bare.yaml"
    whole.write_text(yaml.safe_dump({"groups": [{"name": "robot-offload", "rules": alerts}]}))
    plain = [{key: value for key, value in rule.items() if key != "annotations"} for rule in alerts]
    bare.write_text(yaml.safe_dump({"groups": [{"name": "robot-offload", "rules": plain}]}))
    severity = {rule["alert"]: rule["labels"] for rule in alerts}
    tests = [
        {
            "name": alert,
            "interval": "1m",
            "input_series": [{"series": name, "values": values} for name, values in series.items()],
            "alert_rule_test": [
                {"eval_time": "110m", "alertname": alert, "exp_alerts": [{"exp_labels": {**labels, **severity[alert]}}]}
            ],
        }
        for alert, (series, labels) in FIRES.items()
    ]
    quiet = [{"eval_time": "110m", "alertname": alert, "exp_alerts": []} for alert in FIRES]
    day = [{"series": name, "values": values} for name, values in QUIET.items()]
    tests.append({"name": "quiet", "interval": "1m", "input_series": day, "alert_rule_test": quiet})
    (tmp_path / "test.yaml").write_text(
        yaml.safe_dump({"rule_files": [bare.name], "evaluation_interval": "1m", "tests": tests})
    )
    for arguments in (["check", "rules", str(whole)], ["test", "rules", "test.yaml"]):
        done = subprocess.run(
            [str(tools.path("promtool")), *arguments], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
