"""Pods: what a restricted namespace asks for, what a node is started with, and when it has a pod at all."""

from __future__ import annotations

import itertools
import re
from typing import Any

import pytest

from robot_offload.kube.port import Manifest
from robot_offload.objects.labels import INSTANCE, MANAGED_BY
from tests.unit.operator.render.given import EVERY_ENDPOINT, TRANSPORTS, environment, facts, offload, pods, rendered

CONTROLLER = "Deployment/wheelchair-7-controller"
PLANNER = "Deployment/wheelchair-7-planner"
AGENT = "Deployment/wheelchair-7-agent"


def all_pods(transport: str) -> dict[str, Manifest]:
    return pods(rendered(offload(transport=TRANSPORTS[transport]), facts(endpoints=EVERY_ENDPOINT)))


def container(manifests: dict[str, Manifest], key: str, index: int = 0) -> Manifest:
    found: Manifest = manifests[key]["spec"]["template"]["spec"]["containers"][index]
    return found


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_every_child_is_owned_labelled_and_in_the_namespace(transport: str) -> None:
    for one in rendered(offload(transport=TRANSPORTS[transport]), facts(endpoints=EVERY_ENDPOINT)).values():
        metadata = one["metadata"]
        assert metadata["namespace"] == "robots"
        [owner] = metadata["ownerReferences"]
        assert (owner["uid"], owner["controller"], owner["blockOwnerDeletion"]) == (facts().uid, True, True)
        assert (metadata["labels"][INSTANCE], metadata["labels"][MANAGED_BY]) == ("wheelchair-7", "robot-offload")
        assert "finalizers" not in metadata


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_every_pod_meets_the_restricted_pod_security_level(transport: str) -> None:
    for name, template in all_pods(transport).items():
        spec = template["spec"]
        assert spec["securityContext"]["runAsNonRoot"] is True, name
        assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}, name
        assert spec["automountServiceAccountToken"] is False, name
        assert not {"hostNetwork", "hostPID", "hostIPC"} & spec.keys(), name
        for one in spec["containers"]:
            assert one["securityContext"] == {
                "allowPrivilegeEscalation": False,
                "capabilities": {"drop": ["ALL"]},
                "readOnlyRootFilesystem": True,
            }, name
            assert {"name": "tmp", "mountPath": "/tmp"} in one["volumeMounts"], name


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_every_volume_that_is_mounted_exists_and_the_other_way_round(transport: str) -> None:
    for name, template in all_pods(transport).items():
        mounted = {one["name"] for each in template["spec"]["containers"] for one in each["volumeMounts"]}
        assert mounted == {one["name"] for one in template["spec"]["volumes"]}, name


def test_on_openshift_the_cluster_chooses_the_user() -> None:
    for template in pods(rendered(offload({"cloud.runAsUser": None}))).values():
        assert template["spec"]["securityContext"].keys() == {"runAsNonRoot", "seccompProfile"}


def test_the_agent_has_no_limit_of_the_cpu() -> None:
    for one in rendered()[AGENT]["spec"]["template"]["spec"]["containers"]:
        assert "cpu" not in one["resources"]["limits"]


def test_only_the_reporter_gets_a_token_and_only_for_one_lease_and_one_config_map() -> None:
    manifests = rendered()
    agent, reporter = (container(manifests, AGENT, index) for index in (0, 1))
    assert "token" not in [one["name"] for one in agent["volumeMounts"]]
    assert "token" in [one["name"] for one in reporter["volumeMounts"]]
    rules = manifests["Role/wheelchair-7-agent"]["rules"]
    assert [(rule["resources"], rule["resourceNames"], rule["verbs"]) for rule in rules] == [
        (["leases"], ["wheelchair-7-robot"], ["get", "patch"]),
        (["configmaps"], ["wheelchair-7-settings"], ["get", "watch"]),
    ]


def test_the_robots_lease_says_nothing_that_the_reporter_says() -> None:
    assert rendered()["Lease/wheelchair-7-robot"]["spec"] == {"leaseDurationSeconds": 30}


def test_a_node_finds_the_others_through_the_discovery_servers() -> None:
    values = environment(container(rendered(), CONTROLLER))
    assert values["ROS_DOMAIN_ID"] == "43"
    assert values["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"
    assert values["FASTDDS_BUILTIN_TRANSPORTS"] == "UDPv4"
    assert values["ROS_DISCOVERY_SERVER"] == "10.96.0.8:11811;10.96.0.9:11811", "addresses: a name may be unknown yet"
    assert "ROS_SUPER_CLIENT" not in values


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_nothing_that_needs_the_discovery_servers_is_made_before_their_addresses_are_known(transport: str) -> None:
    known = rendered(offload(transport=TRANSPORTS[transport]), facts(endpoints=EVERY_ENDPOINT))
    unknown = rendered(offload(transport=TRANSPORTS[transport]), facts(endpoints=EVERY_ENDPOINT, discovery_hosts=()))
    missing = {key.partition("/")[0] for key in known.keys() - unknown.keys()}
    expected = {"StaticPeers": set(), "DDSRouter": {"Deployment", "ConfigMap"}}
    assert missing == expected.get(transport, {"Deployment"})


def test_only_the_agent_sees_the_whole_graph() -> None:
    assert environment(container(rendered(), AGENT))["ROS_SUPER_CLIENT"] == "TRUE"


def test_listed_peers_and_discovery_servers_exclude_each_other() -> None:
    manifests = rendered(offload(transport=TRANSPORTS["StaticPeers"]))
    values = environment(container(manifests, AGENT))
    assert values["ROS_STATIC_PEERS"] == "192.0.2.7;192.0.2.8"
    assert not {"ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT"} & values.keys()
    assert not [key for key in manifests if key.startswith("StatefulSet/")]


def test_a_replica_is_started_under_its_remote_name_with_its_output_on_the_private_topic() -> None:
    arguments = container(rendered(), CONTROLLER)["args"]
    assert arguments[:2] == ["python3", "controller.py"]
    assert "controller:__node:=remote_controller" in arguments
    assert "/cmd_vel:=/offload/cloud/cmd_vel" in arguments
    assert "rate_hz:=50.0" in arguments
    assert "command" not in container(rendered(), CONTROLLER)


def test_a_parameter_file_comes_before_the_parameters_that_are_laid_over_it() -> None:
    from_file = {"configMapKeyRef": {"name": "nav", "key": "nav.yaml"}}
    found = rendered(offload({"nodes.1.run.parametersFrom": from_file}))[CONTROLLER]["spec"]["template"]["spec"]
    arguments = found["containers"][0]["args"]
    place = arguments.index("--params-file")
    assert arguments[place + 1] == "/etc/robot-offload/parameters/nav.yaml"
    assert place < arguments.index("-p")
    assert {
        "name": "parameters",
        "configMap": {"name": "nav", "items": [{"key": "nav.yaml", "path": "nav.yaml"}]},
    } in found["volumes"]


def test_a_gpu_node_gets_what_it_asks_for() -> None:
    changes: dict[str, Any] = {
        "nodes.2.resources": {"limits": {"nvidia.com/gpu": 1}, "requests": {"cpu": "2"}},
        "nodes.2.runtimeClassName": "nvidia",
        "nodes.2.nodeSelector": {"gpu": "yes"},
        "cloud.nodeSelector": {"pool": "edge", "gpu": "no"},
        "cloud.tolerations": [{"key": "gpu", "operator": "Exists"}],
        "cloud.imagePullSecrets": [{"name": "registry"}],
    }
    spec = rendered(offload(changes))[PLANNER]["spec"]["template"]["spec"]
    assert spec["containers"][0]["resources"] == {"limits": {"nvidia.com/gpu": "1"}, "requests": {"cpu": "2"}}
    assert spec["runtimeClassName"] == "nvidia"
    assert spec["nodeSelector"] == {"pool": "edge", "gpu": "yes"}
    assert spec["tolerations"] == [{"key": "gpu", "operator": "Exists"}]
    assert spec["imagePullSecrets"] == [{"name": "registry"}]


def test_a_users_variables_are_added_and_may_move_the_home_folder() -> None:
    chosen = [{"name": "HOME", "value": "/data"}, {"name": "MODEL", "value": "a b"}]
    one = container(rendered(offload({"nodes.1.env": chosen})), CONTROLLER)
    assert environment(one)["HOME"] == "/data"
    assert environment(one)["MODEL"] == "a b"
    assert len(one["env"]) == len(environment(one))


def test_a_variable_is_read_from_a_secret_or_a_config_map_by_kubernetes_itself() -> None:
    secret, config = {"name": "camera", "key": "token"}, {"name": "maps", "key": "floor"}
    chosen = [
        {"name": "TOKEN", "valueFrom": {"secretKeyRef": secret}},
        {"name": "FLOOR", "valueFrom": {"configMapKeyRef": config}},
    ]
    given = container(rendered(offload({"nodes.1.env": chosen})), CONTROLLER)["env"]
    assert {"name": "TOKEN", "valueFrom": {"secretKeyRef": secret}} in given
    assert {"name": "FLOOR", "valueFrom": {"configMapKeyRef": config}} in given


def test_before_a_duplicated_node_goes_the_robot_takes_over() -> None:
    manifests = rendered()
    one = container(manifests, CONTROLLER)
    address, _, proof = environment(one)["ROBOT_OFFLOAD_HANDOVER_URL"].rpartition("/")
    assert address == "http://wheelchair-7-agent:8080/handover"
    assert proof == environment(container(rendered(), AGENT, 1))["HANDOVER_PROOF"]
    assert len(proof) == 32
    assert one["lifecycle"]["preStop"]["exec"]["command"][:2] == ["python3", "-c"]
    assert manifests[CONTROLLER]["spec"]["template"]["spec"]["terminationGracePeriodSeconds"] == 20
    assert "lifecycle" not in container(manifests, PLANNER)


def test_nothing_that_a_user_wrote_is_part_of_the_hook() -> None:
    scripts = {
        container(rendered(offload(changes)), CONTROLLER)["lifecycle"]["preStop"]["exec"]["command"][2]
        for changes in ({}, {"nodes.1.env": [{"name": "X", "value": "'); import os"}]})
    }
    assert len(scripts) == 1
    compile(scripts.pop(), "preStop", "exec")


def replicas(standby: str, pin: str = "Auto", mode: str = "Auto", **known: Any) -> int:
    changes = {"nodes.1.standby": {"cloud": standby}, "switching.pin": pin, "switching.mode": mode}
    count: int = rendered(offload(changes), facts(**known))[CONTROLLER]["spec"]["replicas"]
    return count


def test_warm_and_hot_nodes_have_a_pod_while_nodes_are_wanted() -> None:
    for standby, connected in itertools.product(("Warm", "Hot"), (True, False)):
        assert replicas(standby, nodes_wanted=True, robot_connected=connected) == 1
        assert replicas(standby, nodes_wanted=False, robot_connected=connected) == 0


def test_a_cold_node_has_a_pod_only_while_the_robot_is_there_and_may_use_it() -> None:
    assert replicas("Cold", nodes_wanted=True, robot_connected=False) == 0
    assert replicas("Cold", nodes_wanted=True, robot_connected=True) == 1
    assert replicas("Cold", nodes_wanted=False, robot_connected=True) == 0
    assert replicas("Cold", pin="Robot", nodes_wanted=True, robot_connected=True) == 0
    assert replicas("Cold", mode="Observe", nodes_wanted=True, robot_connected=True) == 0


def test_agent_and_discovery_servers_never_go_to_zero() -> None:
    manifests = rendered(offload(replicas=0), facts(nodes_wanted=False))
    kept = [one["spec"]["replicas"] for key, one in manifests.items() if "-discovery-" in key and "Set" in key]
    assert [manifests[AGENT]["spec"]["replicas"], *kept] == [1, 1, 1]
    assert [manifests[key]["spec"]["replicas"] for key in (CONTROLLER, PLANNER)] == [0, 0]


def test_no_pod_is_ever_beside_its_successor() -> None:
    for key, one in rendered().items():
        if key.startswith("Deployment/"):
            assert one["spec"]["strategy"] == {"type": "Recreate"}


def test_the_selector_of_a_workload_finds_its_own_pods_and_no_others() -> None:
    manifests = {key: one for key, one in rendered().items() if "template" in one.get("spec", {})}
    for key, one in manifests.items():
        chosen = one["spec"]["selector"]["matchLabels"].items()
        found = [
            other for other, its in manifests.items() if chosen <= its["spec"]["template"]["metadata"]["labels"].items()
        ]
        assert found == [key]


def test_values_are_never_read_as_yaml_or_shell() -> None:
    image = "registry.example/a:1"
    hostile = 'x"\n      securityContext: {privileged: true}\n$(reboot) `reboot`'
    resource = offload({"nodes.1.run.command": [hostile], "nodes.1.image": image})
    # The kubelet makes `$` of `$$`; a single one before a bracket would be a variable for it.
    assert container(rendered(resource), CONTROLLER)["args"][0] == hostile.replace("$", "$$")


def test_an_address_is_probed_where_the_discovery_server_listens() -> None:
    probe = container(rendered(), "StatefulSet/wheelchair-7-discovery-0")["readinessProbe"]["exec"]["command"]
    port = re.fullmatch(r":([0-9A-F]{4}) ", probe[2])
    assert port is not None
    assert int(port[1], 16) == 11811


def test_every_participant_of_static_peers_asks_more_than_the_first_four_at_an_address() -> None:
    manifests = rendered(offload(transport=TRANSPORTS["StaticPeers"]))
    text = manifests["ConfigMap/wheelchair-7-dds"]["data"]["fastdds.xml"]
    assert "<maxInitialPeersRange>32</maxInitialPeersRange>" in text
    for key in (AGENT, CONTROLLER, PLANNER):
        found = container(manifests, key)
        mounted = {mount["name"]: mount["mountPath"] for mount in found["volumeMounts"]}
        for variable in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
            assert environment(found)[variable] == f"{mounted['dds']}/fastdds.xml"
        volumes = {each["name"]: each for each in manifests[key]["spec"]["template"]["spec"]["volumes"]}
        assert volumes["dds"]["configMap"]["name"] == "wheelchair-7-dds"


@pytest.mark.parametrize("transport", sorted(TRANSPORTS.keys() - {"StaticPeers"}))
def test_other_transports_have_no_profile_of_their_own(transport: str) -> None:
    assert not any("FASTDDS_DEFAULT_PROFILES_FILE" in str(one) for one in all_pods(transport).values())
