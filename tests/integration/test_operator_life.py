"""The life of RobotOffloads under a running operator: made, changed, invalid, edited by others, gone."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_offload.decide.certificates import LEAVES
from robot_offload.kube.kinds import (
    CONFIG_MAP,
    DEPLOYMENT,
    LEASE,
    NAMESPACE,
    ROBOT_OFFLOAD,
    SECRET,
    SERVICE,
    Kind,
)
from robot_offload_lab.cluster.control_plane import ControlPlane
from tests.integration.operator_cluster import Place, eventually, kind_named, walker
from tests.integration.operator_process import Operator
from tests.integration.operator_proxy import Proxy

pytestmark = [pytest.mark.api, pytest.mark.core]
SAMPLES = Path(__file__).resolve().parents[2] / "manifests" / "samples"


def test_a_new_resource_gets_all_its_children_with_its_labels_and_its_owner_reference(place: Place) -> None:
    uid = place.create(ROBOT_OFFLOAD, walker())["metadata"]["uid"]
    roff = place.applied()
    children = place.children()
    assert {kind for kind, _ in children} == {
        "ServiceAccount", "Role", "RoleBinding", "Secret", "ConfigMap", "Lease", "Service", "NetworkPolicy",
        "StatefulSet", "Deployment",
    }  # fmt: skip
    assert {"walker-cloud", "walker-robot"} <= {n for _, n in children}
    for child in children.values():
        (owner,) = child["metadata"]["ownerReferences"]
        assert (owner["uid"], owner["controller"], owner["blockOwnerDeletion"]) == (uid, True, True)
        assert child["metadata"]["labels"]["app.kubernetes.io/managed-by"] == "robot-offload"
        assert "finalizers" not in child["metadata"]
    assert "finalizers" not in roff["metadata"]
    assert not [key for key in roff["metadata"].get("annotations", {}) if "kopf" in key]
    assert roff["status"]["observedGeneration"] == 1
    assert place.condition("Ready")["status"] == "False"
    assert roff["status"]["nodesReady"] == "0/1"


def test_a_plain_apply_is_never_refused_and_posts_no_warning(place: Place, proxy: Proxy) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    proxy.quiet(place.namespace)
    eventually(place.events, "events")
    assert [f"{event['reason']}: {event['message']}" for event in place.events() if event["type"] != "Normal"] == []
    refused = [asked for asked in list(proxy.asked) if place.namespace in asked.path and asked.status >= 400]
    assert [asked for asked in refused if asked.method != "GET"] == []


def test_what_settles_is_never_written_again_not_even_by_a_new_operator(
    place: Place, operator: Operator, proxy: Proxy
) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    proxy.quiet(place.namespace)
    before = place.written()
    version = place.roff()["metadata"]["resourceVersion"]
    count = len(proxy.writes_in(place.namespace))
    operator.restart()
    # A change of another object shows that the new operator has been through everything.
    place.create(ROBOT_OFFLOAD, walker("marker"))
    place.applied("marker")
    proxy.quiet(place.namespace)
    mine = [asked for asked in proxy.writes_in(place.namespace)[count:] if "walker" in asked.path]
    assert mine == []
    assert place.roff()["metadata"]["resourceVersion"] == version
    assert place.written() == before


def test_every_field_of_the_samples_can_be_set_and_unset_again(place: Place, proxy: Proxy) -> None:
    """Through the specifications of all samples and back: the children are as if nothing had happened."""
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = place.shape()
    names = sorted(path.stem for path in SAMPLES.glob("*.yaml"))
    assert len(names) >= 10
    for sample in names:
        (manifest,) = yaml.safe_load_all((SAMPLES / f"{sample}.yaml").read_text())
        place.replace_spec(manifest["spec"])
        place.applied()
        assert place.condition("SpecValid")["status"] == "True", sample
    place.replace_spec(walker()["spec"])
    place.applied()
    eventually(lambda: place.shape().keys() == before.keys(), "no leftover children", lambda: place.shape().keys())
    assert place.shape() == before
    proxy.quiet(place.namespace)


def test_a_changed_child_is_put_right_and_what_others_add_is_left_alone(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    for (kind, name), child in place.children().items():
        of = kind_named(kind)
        labels = {"app.kubernetes.io/component": "edited", "somebody": "else"}
        place.patch(of, name, {"metadata": {"labels": labels, "annotations": {"note": "kept"}}})
        want = child["metadata"]["labels"]["app.kubernetes.io/component"]

        def healed(of: Kind = of, name: str = name, want: str = want) -> bool:
            metadata = place.there(of, name)["metadata"]
            return metadata["labels"]["app.kubernetes.io/component"] == want

        eventually(healed, f"{kind} {name} to be put right")
        metadata = place.there(of, name)["metadata"]
        assert metadata["labels"]["somebody"] == "else"
        assert metadata["annotations"]["note"] == "kept"


def test_edits_of_what_matters_are_undone(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    image = place.there(DEPLOYMENT, "walker-talker")["spec"]["template"]["spec"]["containers"][0]["image"]
    place.patch(DEPLOYMENT, "walker-talker", {"spec": {"replicas": 3}})
    eventually(lambda: place.there(DEPLOYMENT, "walker-talker")["spec"]["replicas"] == 1, "one replica")
    place.patch(CONFIG_MAP, "walker-agent", {"data": {"agent.yaml": "nonsense"}})
    eventually(lambda: place.there(CONFIG_MAP, "walker-agent")["data"]["agent.yaml"] != "nonsense", "the configuration")
    container = {"name": "talker", "image": "evil:1"}
    name = place.there(DEPLOYMENT, "walker-talker")["spec"]["template"]["spec"]["containers"][0]["name"]
    place.patch(
        DEPLOYMENT, "walker-talker", {"spec": {"template": {"spec": {"containers": [{**container, "name": name}]}}}}
    )

    def restored() -> bool:
        containers = place.there(DEPLOYMENT, "walker-talker")["spec"]["template"]["spec"]["containers"]
        return [entry["image"] for entry in containers] == [image]

    eventually(restored, "the image")
    place.patch(SERVICE, "walker-udp", {"metadata": {"ownerReferences": None}})
    eventually(lambda: place.there(SERVICE, "walker-udp")["metadata"].get("ownerReferences"), "the owner")


def test_every_child_that_somebody_deletes_is_made_again(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = place.children()
    for kind, name in before:
        place.delete(kind_named(kind), name)

    def back() -> bool:
        now = place.children()
        return now.keys() == before.keys() and all(
            now[key]["metadata"]["uid"] != child["metadata"]["uid"] for key, child in before.items()
        )

    eventually(back, "all children to be made again")
    place.applied()


def test_who_must_find_a_discovery_server_is_told_its_new_address(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    name, others = "walker-discovery-0", ("walker-agent", "walker-talker")
    before = {each: place.there(DEPLOYMENT, each)["metadata"]["uid"] for each in others}
    old = place.there(SERVICE, name)["spec"]["clusterIP"]
    place.delete(SERVICE, name)
    eventually(lambda: (place.get(SERVICE, name) or {}).get("spec", {}).get("clusterIP", old) != old, "a new address")
    new = place.there(SERVICE, name)["spec"]["clusterIP"]

    def told(deployment: str) -> bool:
        [container, *_] = place.there(DEPLOYMENT, deployment)["spec"]["template"]["spec"]["containers"]
        servers = next(one["value"] for one in container["env"] if one["name"] == "ROS_DISCOVERY_SERVER")
        return f"{new}:11811" in servers.split(";")

    eventually(lambda: all(told(each) for each in others), "both to be told")
    now = {each: place.there(DEPLOYMENT, each)["metadata"]["uid"] for each in others}
    assert now == before, "changed, not replaced"


def test_while_a_discovery_server_cannot_be_had_what_runs_goes_on(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = place.there(DEPLOYMENT, "walker-talker")["metadata"]
    stranger = {"apiVersion": "v1", "kind": "Service", "metadata": {"name": "walker-discovery-2"}}
    place.create(SERVICE, {**stranger, "spec": {"ports": [{"port": 1}]}})
    place.change({"cloud": {"discoveryServers": 3}})
    condition = place.wait_condition("ResourcesApplied", "False", "NameTaken")
    assert "Service walker-discovery-2 exists" in condition["message"]
    now = place.there(DEPLOYMENT, "walker-talker")["metadata"]
    assert (now["uid"], now["generation"]) == (before["uid"], before["generation"])


def test_a_strangers_object_is_not_taken_over_and_the_condition_says_whose_it_is(place: Place) -> None:
    stranger = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "walker-agent"}, "data": {"mine": "yes"}}
    place.create(CONFIG_MAP, stranger)
    place.create(ROBOT_OFFLOAD, walker())
    condition = place.wait_condition("ResourcesApplied", "False", "NameTaken")
    assert "ConfigMap walker-agent exists and has no owner" in condition["message"]
    assert place.there(DEPLOYMENT, "walker-talker")  # the others are made all the same
    assert place.there(CONFIG_MAP, "walker-agent")["data"] == {"mine": "yes"}
    place.delete(CONFIG_MAP, "walker-agent")
    place.patch(ROBOT_OFFLOAD, "walker", {"metadata": {"annotations": {"poke": "1"}}})
    place.wait_condition("ResourcesApplied", "True")
    assert "agent.yaml" in place.there(CONFIG_MAP, "walker-agent")["data"]


def test_two_resources_whose_names_would_meet_in_a_child_both_get_theirs(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker("walker"))
    place.applied("walker")
    other = walker("walker-talker")
    other["spec"]["nodes"][0]["name"] = "agent_x"
    first = walker("walker")["spec"]["nodes"][0]
    place.change({"nodes": [first, {**first, "name": "talker_agent", "outputs": []}]})
    place.applied("walker")
    place.create(ROBOT_OFFLOAD, other)
    place.applied("walker-talker")
    assert ("Deployment", "walker-talker-agent") in place.children("walker-talker")
    assert place.applied("walker")["status"]["nodes"][1]["workload"] != "walker-talker-agent"


def test_an_invalid_resource_says_every_problem_keeps_its_children_and_recovers(place: Place, proxy: Proxy) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    proxy.quiet(place.namespace)
    before = place.written()
    count = len(proxy.writes_in(place.namespace))
    node = walker()["spec"]["nodes"][0]
    twice = [node, {**node, "name": "second"}]
    place.change({"nodes": twice, "topics": {"toCloud": [{"name": "/chatter"}]}})
    condition = place.wait_condition("SpecValid", "False")
    assert "DuplicateOutput" in condition["reason"] or "second" in condition["message"]
    assert len(condition["message"].splitlines()) >= 3  # two problems and what happens to the children
    assert place.wait_condition("Ready", "False")["reason"] == condition["reason"]
    proxy.quiet(place.namespace)
    mine = [asked.path for asked in proxy.writes_in(place.namespace)[count:]]
    assert [path for path in mine if "/robotoffloads/" not in path and "/events" not in path] == []
    assert place.written() == before
    count = len(proxy.asked)
    place.change({"nodes": [node], "topics": None})
    place.wait_condition("SpecValid", "True")
    place.applied()
    assert [asked for asked in proxy.asked[count:] if asked.write]


def test_deleting_the_resource_removes_every_child_and_one_of_the_same_name_starts_afresh(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    first = {child["metadata"]["uid"] for child in place.children().values()}
    place.delete(ROBOT_OFFLOAD, "walker")
    place.create(ROBOT_OFFLOAD, walker())  # at once: the old children are still on their way out
    uid = place.roff()["metadata"]["uid"]
    eventually(
        lambda: (
            place.condition("ResourcesApplied").get("status") == "True"
            and not first & {child["metadata"]["uid"] for child in place.children().values()}
        ),
        "new children only",
    )
    owners = {child["metadata"]["ownerReferences"][0]["uid"] for child in place.children().values()}
    assert owners == {uid}
    place.delete(ROBOT_OFFLOAD, "walker")
    eventually(lambda: not place.children(), "no children")


def test_a_namespace_can_be_deleted_with_everything_in_it(control_plane: ControlPlane, operator: Operator) -> None:
    place = Place(control_plane, control_plane.new_namespace(f"short-lived-{secrets.token_hex(3)}"))
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    place.delete(NAMESPACE, place.namespace)
    place.gone(NAMESPACE, place.namespace)


def test_the_robots_lease_becomes_the_status_and_nodes_sleep_without_a_robot(place: Place, proxy: Proxy) -> None:
    place.create(ROBOT_OFFLOAD, walker(scale={"idleTimeout": "30s"}))
    place.applied()
    assert place.condition("Connected")["reason"] == "NeverConnected"
    place.renew(site="cloud", reason="LinkGood")
    place.wait_condition("Connected", "True", "Connected")
    roff = eventually(
        lambda: roff if (roff := place.roff())["status"]["placement"] == "Cloud" else None, "the placement"
    )
    assert roff["status"]["placementReason"] == "LinkGood"
    assert roff["status"]["robot"]["connected"] is True
    assert place.wait_condition("ConfigCurrent", "True")["reason"] == "Current"
    wanted = {"Connected", "PlacementCloud"}
    eventually(lambda: wanted <= {event["reason"] for event in place.events()}, "the events", place.events)
    proxy.quiet(place.namespace)
    count = proxy.count_in(place.namespace)
    place.patch(LEASE, "walker-robot", {"spec": {"renewTime": "2026-11-21T23:00:10.000000Z"}})
    proxy.quiet(place.namespace)
    assert proxy.count_in(place.namespace) == count, "renewing alone led to a pass"
    place.patch(LEASE, "walker-robot", {"spec": {"holderIdentity": None}})
    place.wait_condition("Connected", "False", "Disconnected")
    assert place.roff()["status"]["placement"] == "Unknown"
    # The idle time counts from the status, so it survives operators; here it is long over.
    place.patch(ROBOT_OFFLOAD, "walker", {"status": {"robot": {"since": "2026-01-01T00:00:00Z"}}}, "status")
    eventually(lambda: place.replicas("walker-talker") == 0, "the node to sleep")
    assert place.replicas("walker-agent") == 1
    place.wait_condition("WorkloadsAvailable", "False")  # the agent has no pod on a server without nodes
    place.renew(site="robot", reason="LinkBad")
    eventually(lambda: place.replicas("walker-talker") == 1, "the node to wake up with the robot")
    # spec.replicas beats everything else, also a connected robot
    place.change({"replicas": 0})
    eventually(lambda: place.replicas("walker-talker") == 0, "no pods")
    assert place.replicas("walker-agent") == 1
    place.wait_condition("ResourcesApplied", "True")
    assert place.roff()["status"]["replicas"] == 0


def test_addresses_of_load_balancers_become_endpoints(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    ingress = {"status": {"loadBalancer": {"ingress": [{"ip": "10.79.0.10"}]}}}
    for name in ("walker-udp", "walker-tcp"):
        place.patch(SERVICE, name, ingress, "status")
    eventually(lambda: len(place.roff()["status"]["endpoints"]) == 4, "four endpoints")
    found = {(point["purpose"], point["protocol"], point["host"]) for point in place.roff()["status"]["endpoints"]}
    assert ("pulse", "UDP", "10.79.0.10") in found
    assert ("data-fallback", "TCP", "10.79.0.10") in found


def secrets_of(place: Place) -> dict[str, Any]:
    """What is in all Secrets of the walker: its own, and its authorities' in the operator's namespace."""
    leaves = {role: place.there(SECRET, f"walker-{role}")["data"] for role in LEAVES}
    return {**leaves, **{role: secret["data"] for role, secret in place.authorities().items()}}


def test_revoking_makes_a_new_client_authority_once_and_rolls_the_agent(place: Place) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    before = secrets_of(place)
    template = place.there(DEPLOYMENT, "walker-agent")["spec"]["template"]["metadata"]["annotations"]
    place.patch(
        ROBOT_OFFLOAD, "walker", {"metadata": {"annotations": {"robotoffload.dev/revoke": "2026-11-21T23:00:00Z"}}}
    )
    eventually(lambda: place.there(SECRET, "walker-robot")["data"] != before["robot"], "a new certificate")
    eventually(
        lambda: place.there(DEPLOYMENT, "walker-agent")["spec"]["template"]["metadata"]["annotations"] != template,
        "the agent to be rolled",
    )
    after = secrets_of(place)
    assert after["server-ca"] == before["server-ca"]
    assert after["client-ca"] != before["client-ca"]
    assert after["cloud"]["ca.crt"] == after["client-ca"]["tls.crt"]
    place.patch(ROBOT_OFFLOAD, "walker", {"metadata": {"annotations": {"poke": "1"}}})
    place.change({"replicas": 0})
    place.applied()
    assert secrets_of(place) == after


def test_an_issuer_without_cert_manager_is_told_and_everything_else_is_made(place: Place) -> None:
    transport = {"type": "Zenoh", "certificates": {"issuerRef": {"name": "fleet", "kind": "Issuer"}}}
    place.create(ROBOT_OFFLOAD, walker(transport=transport))
    condition = place.wait_condition("ResourcesApplied", "False", "NotFound")
    assert "install cert-manager or remove spec.transport.certificates.issuerRef" in condition["message"]
    assert place.condition("CertificatesReady")["reason"] == "WaitingForIssuer"
    assert place.there(DEPLOYMENT, "walker-agent")
    assert not [name for kind, name in place.children() if kind == "Secret"]
    place.change({"transport": {"certificates": {"issuerRef": None}}})
    place.wait_condition("CertificatesReady", "True", "Issued")
    place.applied()


def test_a_users_parameter_file_that_changes_rolls_the_node_that_reads_it(place: Place) -> None:
    spec = walker()["spec"]
    spec["nodes"][0]["run"]["parametersFrom"] = {"configMapKeyRef": {"name": "tuning", "key": "talker.yaml"}}
    place.create(ROBOT_OFFLOAD, walker(**spec))
    place.applied()

    def template() -> object:
        return place.there(DEPLOYMENT, "walker-talker")["spec"]["template"]["metadata"]["annotations"]

    missing = template()
    tuning = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "tuning"}, "data": {"talker.yaml": "a: 1"}}
    place.create(CONFIG_MAP, tuning)
    eventually(lambda: template() != missing, "the node to be rolled when the file appears")
    first = template()
    place.patch(CONFIG_MAP, "tuning", {"data": {"talker.yaml": "a: 2"}})
    eventually(lambda: template() != first, "the node to be rolled when the file changes")


def test_metrics_and_health_tell_what_the_operator_sees(place: Place, operator: Operator) -> None:
    place.create(ROBOT_OFFLOAD, walker())
    place.applied()
    info = f'robot_offload_info{{connected="false",name="walker",namespace="{place.namespace}",ready="'

    def shown() -> str:
        """The metrics, as soon as the operator's own watch has shown it the RobotOffload."""
        status, text = operator.ask("metrics", "/metrics")
        assert status == 200
        return text if info in text else ""

    text = eventually(shown, "the RobotOffload in the metrics", lambda: operator.ask("metrics", "/metrics"))
    values = dict(line.rsplit(" ", 1) for line in text.splitlines() if not line.startswith("#"))
    assert float(values["robot_offload_objects"]) >= 1
    assert float(values["robot_offload_leader"]) == 1
    assert float(values['robot_offload_reconciles_total{result="ok"}']) >= 1
    assert float(values['robot_offload_condition{status="True",type="ResourcesApplied"}']) >= 1
    assert float(values["process_resident_memory_bytes"]) > 0
    assert any(name.startswith("robot_offload_build_info{version=") for name in values)
    assert operator.ask("health", "/livez")[0] == operator.ask("health", "/readyz")[0] == 200
