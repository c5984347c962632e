"""The Grafana dashboards of the chart: Fleet and Robot, as JSON that Grafana 10 and later imports."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Final

SCHEMA: Final = 39
"""Of Grafana 10.4; later ones read it."""
ROBOT: Final = "app_kubernetes_io_instance"
"""Label of the RobotOffload, from the PodMonitor of the agents (`podTargetLabels`)."""
ONE: Final = f'namespace="$namespace",{ROBOT}="$robot"'
ALL: Final = 'namespace=~"$namespace"'
NAMED: Final = f"{{{{namespace}}}}/{{{{{ROBOT}}}}}"
RATE: Final = "[$__rate_interval]"
WIDTH: Final = 24
"""Columns of Grafana's grid."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel.

    Attributes:
        title: what it shows. queries: (PromQL, legend). unit: of Grafana.
        kind: timeseries, stat, table or state-timeline. width: of 24 columns. text: for people who wonder.
    """

    title: str
    queries: tuple[tuple[str, str], ...]
    unit: str = "short"
    kind: str = "timeseries"
    width: int = 8
    text: str = ""


def _quantile(share: float, name: str, by: str) -> str:
    return f"histogram_quantile({share}, sum by (le, {by}) (rate({name}_bucket{{{ONE}}}{RATE})))"


FLEET: Final = (
    Panel("Robots", ((f"count(robot_offload_agent_alive{{{ALL}}})", "robots"),), kind="stat", width=4),
    Panel("Connected", ((f"sum(robot_offload_robot_connected{{{ALL}}})", "connected"),), kind="stat", width=4),
    Panel("In the cloud", ((f'sum(robot_offload_placement{{{ALL},site="cloud"}})', "cloud"),), kind="stat", width=4),
    Panel(
        "Not ready",
        ((f'count(robot_offload_info{{{ALL},ready="False"}}) or vector(0)', "not ready"),),
        kind="stat",
        width=4,
    ),
    Panel("Operators that lead", (("sum(robot_offload_leader)", "leaders"),), kind="stat", width=4),
    Panel(
        "Certificate that ends first",
        ((f"min(robot_offload_certificate_expiration_timestamp_seconds{{{ALL}}}) - time()", "left"),),
        "s",
        "stat",
        4,
    ),
    Panel(
        "Who acts",
        ((f"sum by (site) (robot_offload_placement{{{ALL}}})", "{{site}}"),),
        width=12,
        text="Number of robots by the side in charge; unknown: no robot is heard.",
    ),
    Panel(
        "Changeovers a minute by reason",
        (
            (
                f"sum by (to, reason) (rate(robot_offload_changeovers_total{{{ALL}}}{RATE})) * 60",
                "to {{to}}: {{reason}}",
            ),
        ),
        width=12,
    ),
    Panel(
        "Loop latency, worst robots",
        ((f'topk(10, robot_offload_link_latency_now_seconds{{{ALL},side="robot"}})', NAMED),),
        "s",
    ),
    Panel(
        "Beats lost, worst robots",
        ((f'topk(10, robot_offload_link_loss_ratio{{{ALL},side="robot"}})', NAMED),),
        "percentunit",
    ),
    Panel(
        "Commands overdue, worst robots",
        (
            (
                (
                    f"topk(10, sum by (namespace, {ROBOT}) "
                    f"(rate(robot_offload_command_overdue_seconds_total{{{ALL}}}{RATE})))"
                ),
                NAMED,
            ),
        ),
        "percentunit",
        text="Share of the time in which a rated output should have spoken and did not.",
    ),
    Panel(
        "Conditions that are not True",
        (('robot_offload_condition{status!="True"} > 0', "{{type}} {{status}}"),),
        width=8,
    ),
    Panel("Images built in the cluster", (("robot_offload_builds", "{{reason}}"),), width=8),
    Panel(
        "Passes of the operator",
        (
            (f"sum by (result) (rate(robot_offload_reconciles_total{RATE}))", "{{result}} a second"),
            ("robot_offload_queue", "waiting"),
            ("robot_offload_queue_late_seconds", "oldest waits s"),
        ),
        width=8,
    ),
)
ONE_ROBOT: Final = (
    Panel("Who acts", ((f"robot_offload_placement{{{ONE}}}", "{{site}}"),), kind="state-timeline", width=24),
    Panel(
        "Loop latency now",
        (
            (f"robot_offload_link_latency_now_seconds{{{ONE}}}", "{{side}}"),
            (f"robot_offload_round_trip_seconds{{{ONE}}}", "cloud q{{quantile}}"),
        ),
        "s",
        width=12,
    ),
    Panel("Beats lost", ((f"robot_offload_link_loss_ratio{{{ONE}}}", "{{side}} misses"),), "percentunit", width=12),
    Panel(
        "Round trips, quantiles",
        tuple(
            (_quantile(share, "robot_offload_link_latency_seconds", "side"), f"{{{{side}}}} q{share}")
            for share in (0.5, 0.99)
        ),
        "s",
    ),
    Panel(
        "Time between commands, quantiles",
        tuple(
            (_quantile(share, "robot_offload_command_gap_seconds", "output"), f"{{{{output}}}} q{share}")
            for share in (0.5, 0.99)
        ),
        "s",
        text="What the driver sees of everything: a changeover without a gap does not show here.",
    ),
    Panel(
        "Commands overdue",
        ((f"rate(robot_offload_command_overdue_seconds_total{{{ONE}}}{RATE})", "{{output}}"),),
        "percentunit",
    ),
    Panel(
        "Changeovers since the agents began",
        ((f"robot_offload_changeovers_total{{{ONE}}}", "to {{to}}: {{reason}}"),),
        kind="table",
    ),
    Panel(
        "Losses of the cloud",
        (
            (f"robot_offload_loss_detections_total{{{ONE}}}", "takeovers by silence"),
            (f"robot_offload_false_alarms_total{{{ONE}}}", "of these false alarms"),
            (f"robot_offload_nobody_in_charge_seconds_total{{{ONE}}}", "s without a good beat"),
        ),
    ),
    Panel("Ready to act", ((f"robot_offload_side_ready{{{ONE}}}", "{{side}}"),), kind="state-timeline"),
    Panel(
        "Bytes over the link",
        ((f"rate(robot_offload_topic_bytes_total{{{ONE}}}{RATE})", "{{topic}} {{direction}}"),),
        "Bps",
        width=12,
    ),
    Panel(
        "Messages over the link",
        ((f"rate(robot_offload_topic_messages_total{{{ONE}}}{RATE})", "{{topic}} {{direction}}"),),
        "cps",
        width=12,
    ),
    Panel(
        "Left out on the robot",
        ((f'rate(robot_offload_input_messages_total{{{ONE},fate!="sent"}}{RATE})', "{{topic}} {{fate}}"),),
        "cps",
        text="Above the rate of the resource, thinned because the link carries less, or not taken by the link.",
    ),
    Panel(
        "Refused by the robot",
        ((f"rate(robot_offload_refused_messages_total{{{ONE}}}{RATE})", "{{reason}}"),),
        "cps",
    ),
    Panel("Goals", ((f"robot_offload_goals_total{{{ONE}}}", "{{action}} {{outcome}}"),)),
    Panel(
        "Goals and calls in flight",
        (
            (f"robot_offload_open_goals{{{ONE}}}", "{{action}} {{state}}"),
            (f"robot_offload_open_calls{{{ONE}}}", "{{service}}"),
            (f"robot_offload_goal_restarts_total{{{ONE}}}", "{{action}} restarts"),
        ),
        text="Of clients on the robot. A restart: the execution began anew, mostly on the other side.",
    ),
    Panel(
        "Age of the state at the last change",
        ((f"robot_offload_state_age_at_change_seconds{{{ONE}}}", "{{side}} {{state}}"),),
        "s",
    ),
    Panel("Nodes in the cloud", ((f"robot_offload_node_state{{{ONE}}}", "{{node}} {{state}}"),), kind="state-timeline"),
    Panel(
        "Processor time of the agents",
        (
            (
                f"sum by (side, process) (rate(robot_offload_process_cpu_seconds_total{{{ONE}}}{RATE}))",
                "{{side}} {{process}}",
            ),
        ),
        "percentunit",
    ),
    Panel(
        "Memory of the agents",
        ((f"robot_offload_process_resident_memory_bytes{{{ONE}}}", "{{side}} {{process}}"),),
        "bytes",
    ),
)
BOARDS: Final = {
    "fleet": ("Robot Offload: Fleet", FLEET, "robot_offload_agent_alive", True),
    "robot": ("Robot Offload: Robot", ONE_ROBOT, "robot_offload_agent_alive", False),
}
FOLDER: Final = "charts/robot-offload/files/dashboards"


def dashboards() -> dict[str, str]:
    """Return path below the repository -> JSON, of each dashboard."""
    return {
        f"{FOLDER}/{name}.json": json.dumps(_board(name, title, panels, source, many), indent=1) + "\n"
        for name, (title, panels, source, many) in BOARDS.items()
    }


def _board(name: str, title: str, panels: tuple[Panel, ...], source: str, many: bool) -> dict[str, Any]:
    variables: list[dict[str, Any]] = [
        {"name": "datasource", "label": "Data source", "type": "datasource", "query": "prometheus"},
        _variable("namespace", f"label_values({source}, namespace)", many),
    ]
    if not many:
        variables.append(_variable("robot", f'label_values({source}{{namespace="$namespace"}}, {ROBOT})', False))
    return {
        "title": title,
        "uid": f"robot-offload-{name}",
        "tags": ["robot-offload"],
        "schemaVersion": SCHEMA,
        "editable": True,
        "refresh": "30s",
        "time": {"from": "now-1h", "to": "now"},
        "templating": {"list": variables},
        "panels": list(_placed(panels)),
    }


def _variable(name: str, query: str, many: bool) -> dict[str, Any]:
    chosen = {"includeAll": True, "multi": True, "current": {"text": "All", "value": "$__all"}} if many else {}
    return {
        "name": name,
        "label": name.capitalize(),
        "type": "query",
        "query": {"query": query, "refId": name},
        "datasource": _source(),
        "refresh": 2,
        "sort": 1,
        **chosen,
    }


def _source() -> dict[str, str]:
    return {"type": "prometheus", "uid": "${datasource}"}


def _placed(panels: tuple[Panel, ...]) -> list[dict[str, Any]]:
    """Place panels from left to right, in rows of equal height."""
    found, x, y, height = [], 0, 0, 0
    for number, panel in enumerate(panels, 1):
        if x + panel.width > WIDTH:
            x, y, height = 0, y + height, 0
        tall = 4 if panel.kind == "stat" else 8
        targets = [
            {"refId": chr(65 + index), "expr": query, "legendFormat": legend, "datasource": _source()}
            | ({"instant": True, "format": "table"} if panel.kind == "table" else {})
            for index, (query, legend) in enumerate(panel.queries)
        ]
        found.append(
            {
                "id": number,
                "type": panel.kind,
                "title": panel.title,
                "description": panel.text,
                "datasource": _source(),
                "targets": targets,
                "gridPos": {"x": x, "y": y, "w": panel.width, "h": tall},
                "fieldConfig": {"defaults": {"unit": panel.unit}, "overrides": []},
            }
        )
        x, height = x + panel.width, max(height, tall)
    return found
