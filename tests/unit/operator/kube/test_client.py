"""The adapter over HTTP: what it sends, what it makes of answers, and when it asks again."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from aiohttp import web

from robot_offload.kube import errors
from robot_offload.kube.configuration import connect, current_namespace
from robot_offload.kube.kinds import CONFIG_MAP, NODE
from robot_offload.kube.port import KubeApi
from robot_offload.kube.retry import RetryPolicy

CONFIG = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "settings", "namespace": "fleet"}}
Answer = tuple[int, object] | tuple[int, object, dict[str, str]]


class Server:
    """Answers requests from a list, the last answer for ever, and keeps what it was asked."""

    def __init__(self, *answers: Answer) -> None:
        self.answers = list(answers)
        self.requests: list[tuple[str, str, dict[str, str], str, dict[str, str]]] = []

    async def answer(self, request: web.Request) -> web.Response:
        self.requests.append(
            (request.method, request.path, dict(request.query), await request.text(), dict(request.headers))
        )
        status, body, *headers = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if status == 0:
            await asyncio.sleep(3600)
        text = body if isinstance(body, str) else json.dumps(body)
        return web.Response(
            status=status, text=text, content_type="application/json", headers=headers[0] if headers else {}
        )


def run(
    tmp_path: Path,
    server: Server,
    act: Callable[[KubeApi], Awaitable[Any]],
    retry: RetryPolicy | None = None,
) -> Any:
    async def main() -> Any:
        application = web.Application()
        application.router.add_route("*", "/{path:.*}", server.answer)
        runner = web.AppRunner(application, shutdown_timeout=0.1)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        port = runner.addresses[0][1]
        api = connect(kubeconfig(tmp_path, port), retry=retry)
        try:
            return await act(api)
        finally:
            await api.close()
            await runner.cleanup()

    return asyncio.run(main())


def kubeconfig(folder: Path, port: int, token: str = "secret", scheme: str = "http", **cluster: str) -> str:
    path = folder / "kubeconfig"
    path.write_text(
        json.dumps(
            {
                "current-context": "here",
                "contexts": [
                    {"name": "here", "context": {"cluster": "c", "user": "u", "namespace": "fleet"}},
                    {"name": "there", "context": {"cluster": "c", "user": "u"}},
                ],
                "clusters": [{"name": "c", "cluster": {"server": f"{scheme}://127.0.0.1:{port}", **cluster}}],
                "users": [{"name": "u", "user": {"token": token}}],
            }
        )
    )
    return str(path)


def refusal(code: int, reason: str, message: str = "no", **details: Any) -> dict[str, Any]:
    return {"kind": "Status", "code": code, "reason": reason, "message": message, "details": details}


def test_apply_sends_our_fields_under_our_name_and_returns_the_object(tmp_path: Path) -> None:
    server = Server((200, {**CONFIG, "data": {"a": "b"}}))
    result = run(tmp_path, server, lambda api: api.apply({**CONFIG, "data": {"a": "b"}}, force=True))
    method, path, query, body, headers = server.requests[0]
    assert (method, path) == ("PATCH", "/api/v1/namespaces/fleet/configmaps/settings")
    assert query == {"fieldManager": "robot-offload", "force": "true"}
    assert headers["Content-Type"].partition(";")[0] == "application/apply-patch+yaml"
    assert headers["Authorization"].lower() == "bearer secret"
    assert json.loads(body)["data"] == {"a": "b"}
    assert result["data"] == {"a": "b"}


def test_any_text_is_applied_as_yaml_that_means_the_same(tmp_path: Path) -> None:
    texts = {"robot": "\N{ROBOT FACE} fährt 走", "control": "\x7f\x85\x9b\u2028\ufeff\uffff", "quoted": '"\\n'}
    server = Server((200, CONFIG))
    run(tmp_path, server, lambda api: api.apply({**CONFIG, "data": texts}))
    body = server.requests[0][3]
    assert json.loads(body)["data"] == texts
    assert yaml.safe_load(body)["data"] == texts


def test_apply_without_force_does_not_ask_for_fields_of_others(tmp_path: Path) -> None:
    server = Server((200, CONFIG))
    run(tmp_path, server, lambda api: api.apply(CONFIG))
    assert "force" not in server.requests[0][2]


def test_a_missing_object_is_none(tmp_path: Path) -> None:
    server = Server((404, refusal(404, "NotFound")))
    assert run(tmp_path, server, lambda api: api.get(CONFIG_MAP, "fleet", "settings")) is None


def test_a_list_follows_pages_and_names_the_kind_of_its_items(tmp_path: Path) -> None:
    server = Server(
        (200, {"items": [{"metadata": {"name": "a"}}], "metadata": {"continue": "more"}}),
        (200, {"items": [{"metadata": {"name": "b"}}], "metadata": {}}),
    )
    found = run(tmp_path, server, lambda api: api.list(CONFIG_MAP, "fleet", {"b": "2", "a": "1"}))
    assert [(item["kind"], item["metadata"]["name"]) for item in found] == [("ConfigMap", "a"), ("ConfigMap", "b")]
    assert server.requests[0][2]["labelSelector"] == "a=1,b=2"
    assert server.requests[1][2]["continue"] == "more"


def test_objects_without_a_namespace_have_a_path_of_their_own(tmp_path: Path) -> None:
    server = Server((200, {"items": []}))
    run(tmp_path, server, lambda api: api.list(NODE))
    assert server.requests[0][1] == "/api/v1/nodes"


def test_deleting_names_the_uid_and_is_quiet_when_the_object_is_gone(tmp_path: Path) -> None:
    server = Server((404, refusal(404, "NotFound")))
    run(tmp_path, server, lambda api: api.delete(CONFIG_MAP, "fleet", "settings", "u-1"))
    assert json.loads(server.requests[0][3])["preconditions"] == {"uid": "u-1"}


def test_a_status_is_written_to_its_subresource_with_its_preconditions_only(tmp_path: Path) -> None:
    server = Server((200, CONFIG))
    manifest = {
        "apiVersion": "robotoffload.dev/v1alpha1",
        "kind": "RobotOffload",
        "metadata": {"name": "w", "namespace": "fleet", "uid": "u", "resourceVersion": "7", "labels": {"a": "b"}},
        "status": {"placement": "Robot"},
    }
    run(tmp_path, server, lambda api: api.patch_status(manifest))
    method, path, _, body, headers = server.requests[0]
    assert (method, path.rsplit("/", 1)[1]) == ("PATCH", "status")
    assert headers["Content-Type"] == "application/merge-patch+json"
    assert json.loads(body) == {
        "metadata": {"uid": "u", "resourceVersion": "7"},
        "status": {"placement": "Robot"},
    }


@pytest.mark.parametrize(
    ("status", "reason", "expected"),
    [
        (400, "BadRequest", errors.InvalidObjectError),
        (403, "Forbidden", errors.ForbiddenError),
        (409, "Conflict", errors.ConflictError),
        (409, "AlreadyExists", errors.AlreadyExistsError),
        (415, "UnsupportedMediaType", errors.InvalidObjectError),
        (422, "Invalid", errors.InvalidObjectError),
        (429, "TooManyRequests", errors.TooManyError),
        (500, "InternalError", errors.ServerFailedError),
        (503, "ServiceUnavailable", errors.ServerFailedError),
        (504, "Timeout", errors.ServerFailedError),
    ],
)
def test_each_refusal_has_an_error_of_its_own(
    tmp_path: Path, status: int, reason: str, expected: type[errors.KubeError]
) -> None:
    server = Server((status, refusal(status, reason, "why not")))
    with pytest.raises(errors.KubeError, match="cannot create ConfigMap fleet/settings: why not") as caught:
        run(tmp_path, server, lambda api: api.create(CONFIG), RetryPolicy(attempts=1))
    assert type(caught.value) is expected
    assert caught.value.status == status


def test_causes_of_an_invalid_object_are_kept(tmp_path: Path) -> None:
    causes = [{"field": "spec.replicas", "message": "must be 0 or 1"}]
    server = Server((422, refusal(422, "Invalid", causes=causes)))
    with pytest.raises(errors.InvalidObjectError) as caught:
        run(tmp_path, server, lambda api: api.apply(CONFIG))
    assert caught.value.details == (("spec.replicas", "must be 0 or 1"),)
    assert len(server.requests) == 1


@pytest.mark.parametrize("status", [429, 500, 503])
def test_what_may_be_repeated_is_repeated_when_the_server_is_in_trouble(tmp_path: Path, status: int) -> None:
    server = Server((status, "not json", {"Retry-After": "0"}), (200, CONFIG))
    assert run(tmp_path, server, lambda api: api.apply(CONFIG)) == CONFIG
    assert len(server.requests) == 2


def test_a_create_is_not_sent_twice_when_it_may_have_happened(tmp_path: Path) -> None:
    server = Server((500, "boom"), (201, CONFIG))
    with pytest.raises(errors.ServerFailedError):
        run(tmp_path, server, lambda api: api.create(CONFIG))
    assert len(server.requests) == 1


def test_a_create_is_repeated_when_it_surely_did_not_happen(tmp_path: Path) -> None:
    server = Server((429, "slow down", {"Retry-After": "0"}), (201, CONFIG))
    assert run(tmp_path, server, lambda api: api.create(CONFIG)) == CONFIG


def test_a_long_pause_asked_for_is_left_to_the_caller(tmp_path: Path) -> None:
    server = Server((429, "slow down", {"Retry-After": "120"}))
    with pytest.raises(errors.TooManyError) as caught:
        run(tmp_path, server, lambda api: api.apply(CONFIG))
    assert caught.value.retry_after_s == 120
    assert len(server.requests) == 1


def test_silence_is_an_error_after_the_timeout(tmp_path: Path) -> None:
    server = Server((0, ""))
    with pytest.raises(errors.UnreachableError, match="no answer within"):
        run(
            tmp_path,
            server,
            lambda api: api.get(CONFIG_MAP, "fleet", "settings"),
            RetryPolicy(attempts=1, request_timeout_s=0.2),
        )


def test_nobody_there_is_an_error_that_says_so(tmp_path: Path) -> None:
    async def main() -> None:
        api = connect(kubeconfig(tmp_path, 1), retry=RetryPolicy(attempts=1))
        try:
            await api.get(CONFIG_MAP, "fleet", "settings")
        finally:
            await api.close()

    with pytest.raises(errors.UnreachableError, match="cannot get ConfigMap fleet/settings"):
        asyncio.run(main())


def test_a_token_that_was_replaced_is_read_again(tmp_path: Path) -> None:
    class Rotating(Server):
        async def answer(self, request: web.Request) -> web.Response:
            kubeconfig(tmp_path, request.url.port or 0, token="fresh")
            return await super().answer(request)

    server = Rotating((401, refusal(401, "Unauthorized")), (200, CONFIG))
    assert run(tmp_path, server, lambda api: api.get(CONFIG_MAP, "fleet", "settings")) == CONFIG
    tokens = [headers["Authorization"] for *_, headers in server.requests]
    assert [token.lower() for token in tokens] == ["bearer secret", "bearer fresh"]


def test_credentials_that_stay_wrong_are_an_error(tmp_path: Path) -> None:
    server = Server((401, refusal(401, "Unauthorized")))
    with pytest.raises(errors.UnauthorizedError):
        run(tmp_path, server, lambda api: api.get(CONFIG_MAP, "fleet", "settings"))
    assert len(server.requests) == 2


def test_a_context_that_does_not_exist_is_named(tmp_path: Path) -> None:
    async def main() -> None:
        api = connect(kubeconfig(tmp_path, 1), context="nowhere")
        await api.get(CONFIG_MAP, "fleet", "settings")

    with pytest.raises(errors.NotConfiguredError, match="nowhere"):
        asyncio.run(main())


def test_the_namespace_is_the_one_of_the_context(tmp_path: Path) -> None:
    file = kubeconfig(tmp_path, 1)
    assert current_namespace(file) == "fleet"
    assert current_namespace(file, "there") == "default"


def test_a_write_that_was_meant_for_an_object_that_has_been_replaced_is_a_conflict() -> None:
    """Most kinds answer 409 to another uid; Services answer 422, which would not be tried again."""
    causes = [{"reason": "FieldValueInvalid", "field": "metadata.uid", "message": "field is immutable"}]
    body = {"kind": "Status", "reason": "Invalid", "message": "is invalid", "details": {"causes": causes}}
    found = errors.error_of(422, json.dumps(body), {}, "apply Service fleet/walker-udp")
    assert isinstance(found, errors.ConflictError)
    assert found.retriable


@pytest.mark.parametrize("command", ["no-such-plugin", "false"])
def test_a_program_for_credentials_that_is_missing_or_fails_is_named_and_nothing_is_asked(
    tmp_path: Path, command: str, capfd: pytest.CaptureFixture[str]
) -> None:
    server = Server((200, CONFIG))

    async def act(_: KubeApi) -> None:
        path = tmp_path / "with-plugin"
        values = yaml.safe_load((tmp_path / "kubeconfig").read_text())
        plugin = {"apiVersion": "client.authentication.k8s.io/v1", "command": command, "interactiveMode": "Never"}
        values["users"] = [{"name": "u", "user": {"exec": plugin}}]
        path.write_text(json.dumps(values))
        api = connect(str(path))
        try:
            await api.get(CONFIG_MAP, "fleet", "settings")
        finally:
            await api.close()

    with pytest.raises(errors.NotConfiguredError, match=r"has no credentials: .*users\[\]\.user\.exec"):
        run(tmp_path, server, act)
    assert server.requests == []
    assert "Errno" not in capfd.readouterr().err
