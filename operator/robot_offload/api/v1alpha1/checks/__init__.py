"""Rules between fields, in one list. Each check is a pure function (spec) -> findings.

A check gets a specification whose single fields are right already. Findings of severity `error` refuse it. What the
API server can judge by itself stands in `rules` too, in its own language.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload.api.v1alpha1.checks import cloud, connection, nodes, switching
from robot_offload.api.v1alpha1.checks.findings import Check
from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.findings import Finding

_EVERYWHERE: Final[tuple[Check, ...]] = (
    connection.transport_block_fits_type,
    connection.exposure_is_consistent,
    connection.certificates_are_renewed_in_time,
    connection.domains_are_one_where_they_must,
    connection.domains_avoid_ephemeral_ports,
    cloud.pull_secrets_are_unique,
    cloud.tolerations_are_complete,
    nodes.names_are_unique,
    nodes.crossing_topics_are_distinct,
    nodes.latched_topics_are_transient_local,
    nodes.nodes_are_complete,
    cloud.environment_is_free,
    cloud.images_come_from_one_place,
    cloud.git_secrets_fit,
    nodes.runs_name_one_program,
    nodes.doubles_survive_kubernetes,
    nodes.core_nodes_can_stop_the_robot,
    switching.loss_timeout_fits_heartbeat,
    switching.loop_latency_is_possible,
    switching.lease_outlives_detection,
    switching.command_age_covers_loop,
    switching.hold_down_grows,
)
CHECKS: Final[tuple[Check, ...]] = (*_EVERYWHERE, cloud.cloud_nodes_have_images("warning"))
"""The rules for a run on one machine, where processes need no images."""
CLUSTER_CHECKS: Final[tuple[Check, ...]] = (
    *_EVERYWHERE,
    cloud.cloud_nodes_have_images("error"),
    cloud.cloud_nodes_say_how_they_start,
    cloud.cloud_rmw_knows_discovery_servers,
)
"""The rules of a cluster: what the operator and `validate --cluster` ask for."""


def check(spec: RobotOffloadSpec, rules: Sequence[Check] = CHECKS) -> tuple[Finding, ...]:
    """Everything that the rules between fields find, in the order of the rules.

    Args:
        spec: what is checked.
        rules: CHECKS (the default, for a run on one machine) or CLUSTER_CHECKS.
    """
    return tuple(finding for rule in rules for finding in rule(spec))


__all__ = ["CHECKS", "CLUSTER_CHECKS", "Check", "check"]
