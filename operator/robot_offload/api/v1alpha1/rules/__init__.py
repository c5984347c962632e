"""Rules between fields. Most stand in tables (`Rule`), each once for the API server (CEL) and for Python.

What CEL cannot say at a bearable cost (an output of two nodes, keys of mappings, topics that differ in underscores) and
what only warns are functions (spec) -> findings. All get a specification whose single fields are right already.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robot_offload.api.v1alpha1.robotoffload import RobotOffloadSpec
from robot_offload.api.v1alpha1.rules import (
    bandwidth,
    cloud,
    connection,
    nodes,
    not_yet,
    pools,
    resources,
    served,
    standby,
    switching,
)
from robot_offload.api.v1alpha1.rules.findings import Check
from robot_offload.api.v1alpha1.rules.rule import Rule
from robot_offload.findings import Finding

RULES: Final[tuple[Rule, ...]] = (
    *connection.RULES,
    *cloud.RULES,
    *resources.RULES,
    *nodes.RULES,
    *served.RULES,
    *pools.RULES,
    *switching.RULES,
    *not_yet.RULES,
)
"""The rules of the CRD, which Python knows as well."""
_FUNCTIONS: Final[tuple[Check, ...]] = (
    connection.node_ports_are_distinct,
    connection.annotations_are_not_ours,
    connection.domains_avoid_ephemeral_ports,
    connection.strangers_are_kept_out,
    cloud.pull_secrets_are_unique,
    cloud.variables_are_unique,
    resources.resources_are_known,
    nodes.names_are_unique,
    nodes.crossing_topics_are_distinct,
    nodes.nodes_do_what_they_say,
    nodes.doubles_survive_kubernetes,
    nodes.parameters_keep_their_names,
    nodes.core_nodes_can_stop_the_robot,
    nodes.shared_topics_are_carried,
    served.names_have_one_meaning,
    served.clients_find_their_servers,
    served.names_outside_have_one_placement,
    served.conditions_name_actions_of_the_group,
    served.conditions_name_topics_of_both_sides,
    served.poses_are_kept,
    served.copied_parameters_have_a_replica,
    standby.hot_nodes_cost_twice,
    standby.hot_outputs_survive_a_lost_message,
    served.not_too_many_names,
    pools.pools_serve_the_robot,
    bandwidth.large_topics_fit_the_link,
    switching.losses_are_noticed_soon,
)
CHECKS: Final[tuple[Check, ...]] = (
    *_FUNCTIONS,
    *(rule.check(rule.alone) for rule in RULES if not rule.cluster_only),
)
"""The rules for a run on one machine, where processes need no images."""
CLUSTER_CHECKS: Final[tuple[Check, ...]] = (*_FUNCTIONS, *(rule.check() for rule in RULES))
"""The rules of a cluster: what the operator and `validate --cluster` ask for."""


def check(spec: RobotOffloadSpec, rules: Sequence[Check] = CHECKS) -> tuple[Finding, ...]:
    """Return everything that the rules between fields find, in the order of the rules.

    Args:
        spec: what is checked.
        rules: CHECKS (the default, for a run on one machine) or CLUSTER_CHECKS.
    """
    return tuple(finding for rule in rules for finding in rule(spec))


__all__ = ["CHECKS", "CLUSTER_CHECKS", "RULES", "Check", "Rule", "check"]
