"""The reporter's pages: probes, metrics, the state as it is, and the handover."""

from __future__ import annotations

import hmac
from collections.abc import Callable
from typing import Final

from aiohttp import web

from robot_offload.api.agent_state import Sight, silence
from robot_offload.reporter.handover import Handovers, Outcome
from robot_offload.reporter.leaving import MEMBER, Leaving
from robot_offload.reporter.metrics import Counts, exposition
from robot_offload.reporter.stream import Streams

STATUS: Final = {Outcome.DONE: 200, Outcome.AGENT_SILENT: 503, Outcome.TOO_LATE: 504}
METRICS_TYPE: Final = "text/plain; version=1.0.0; charset=utf-8"


def application(
    sight: Callable[[], Sight],
    counts: Counts,
    handovers: Handovers,
    leaving: Leaving,
    proof: str,
    streams: Streams,
    now: Callable[[], float],
) -> web.Application:
    """Return the HTTP application.

    Args:
        sight: the agent's state as last seen.
        counts: of this process.
        handovers: asks the agent to hand over.
        leaving: asks the agent about a pod of a pool that is to end.
        proof: the word that a handover request must carry.
        streams: the clients that follow the state.
        now: the steady clock in seconds.
    """

    async def healthz(_: web.Request) -> web.Response:
        return web.Response(text="ok\n")

    async def readyz(_: web.Request) -> web.Response:
        problem = not_ready(sight(), now())
        return web.Response(text=f"{problem or 'ok'}\n", status=503 if problem else 200)

    async def state(_: web.Request) -> web.Response:
        seen = sight()
        if not seen.fresh(now()):
            return web.json_response({"problem": not_ready(seen, now())}, status=503)
        return web.Response(text=seen.text, content_type="application/json")

    async def metrics(_: web.Request) -> web.Response:
        return web.Response(body=exposition(sight(), counts, now()), headers={"Content-Type": METRICS_TYPE})

    app = web.Application()
    app.add_routes(
        [
            web.get("/healthz", healthz),
            web.get("/readyz", readyz),
            web.get("/state", state),
            web.get("/stream", streams.serve, allow_head=False),
            web.get("/metrics", metrics),
            *_asked_by_pods(counts, handovers, leaving, proof),
        ]
    )
    app.on_shutdown.append(streams.close)
    return app


def _asked_by_pods(counts: Counts, handovers: Handovers, leaving: Leaving, proof: str) -> list[web.RouteDef]:
    """Return the routes for pods that are about to stop."""

    def known(request: web.Request) -> bool:
        return hmac.compare_digest(request.match_info["proof"].encode(), proof.encode())

    async def leave(request: web.Request) -> web.Response:
        member = request.match_info["member"]
        if not known(request):
            return web.json_response({"message": "only pods of this RobotOffload may ask to leave"}, status=403)
        if not MEMBER.fullmatch(member):
            return web.json_response({"message": "this is not a name that pods of pools have"}, status=400)
        try:
            outcome = await leaving.leave(member)
        except OSError as error:
            return web.json_response({"message": f"the agent cannot be asked: {error.strerror}"}, status=500)
        return web.json_response({"reason": outcome.value}, status=STATUS[outcome])

    async def handover(request: web.Request) -> web.Response:
        if not known(request):
            return web.json_response({"message": "only pods of this RobotOffload may ask for a handover"}, status=403)
        counts.handovers += 1
        try:
            answer = await handovers.hand_over()
        except OSError as error:
            return web.json_response({"message": f"the agent cannot be asked: {error.strerror}"}, status=500)
        body = {"handover": answer.id, "reason": answer.outcome.value, "message": answer.message}
        return web.json_response(body, status=STATUS[answer.outcome])

    return [web.post("/handover/{proof}", handover), web.post("/leave/{proof}/{member}", leave)]


def not_ready(sight: Sight, now_s: float) -> str:
    """Return why the cloud agent is not ready; empty if it is."""
    if problem := silence(sight, now_s):
        return problem
    assert sight.state is not None
    if not sight.state.ready:
        return f"the cloud agent is not ready: {sight.state.message or sight.state.reason or 'it gives no reason'}"
    return ""
