"""The robot relay's part for served services: calls of clients outside the group."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from robot_offload_core.fence.token import Site, Token
from robot_offload_core.relay.goals import journal
from robot_offload_core.relay.goals.ports import Face, RobotRelayPorts
from robot_offload_core.relay.goals.requests import SENTENCES, AskServer, Desk, Fail, Failure, Order, Reply
from robot_offload_core.relay.goals.state import View
from robot_offload_core.relay.goals.words import CalledWord, CallVerdict, CallWord
from robot_offload_core.relay.post import Post
from robot_offload_core.relay.process import MAX_PAYLOAD, RelayPlan
from robot_offload_core.words.messages import RelayOrders

NOBODY = Token("", 0, "")


class RobotRequests:
    """Clients' calls at served services.

    Attributes:
        desk: requests at served services.
        calls: open calls of clients, caller -> service.
        orders: of control.
    """

    def __init__(
        self,
        plan: RelayPlan,
        ports: RobotRelayPorts,
        post: Post,
        view: Callable[[], View],
        keep: Callable[[bytes], bool],
        counters: Counter[str],
    ) -> None:
        self.ports = ports
        self.post = post
        self.view = view
        self.keep = keep
        self.counters = counters
        self.desk = Desk(plan.services)
        self.calls: dict[bytes, str] = {}
        self.orders: RelayOrders | None = None

    def fail_open(self, calls: dict[bytes, str]) -> None:
        """Fail the calls that a predecessor had open: it is unknown whether they were executed."""
        for caller, service in calls.items():
            if service in self.desk.services:
                self._carry_out(Fail(service, caller, Failure.RELAY_RESTARTED))

    def settle(self) -> None:
        """Let the desk and the used calls decide under the present view."""
        now_s, view = self.ports.now_s(), self.view()
        if not view.heard and view.holding.site is Site.ROBOT:
            self.desk.lost(Site.CLOUD)
        for order in self.desk.settle(view, now_s):
            self._carry_out(order)

    # -- served services ----------------------------------------------------------------------------------------------

    def called(self, name: str, caller: bytes, payload: bytes) -> None:
        """Take a client's call."""
        if len(payload) > MAX_PAYLOAD:
            self._carry_out(Fail(name, caller, Failure.TOO_LARGE))
            return
        self.calls[caller] = name
        self.keep(journal.call_opened(caller, name))
        for order in self.desk.called(name, caller, payload, self.ports.now_s()):
            self._carry_out(order)
        self.settle()

    def answered(self, number: int, payload: bytes, success: bool) -> None:
        """Take the answer of a server."""
        for order in self.desk.answered(number, payload, success):
            self._carry_out(order)
        self.settle()

    def take(self, word: CalledWord) -> None:
        """Take the cloud relay's answer to an ask."""
        if word.verdict in (CallVerdict.DONE, CallVerdict.FAILED):
            self.answered(word.key, word.payload, word.verdict is CallVerdict.DONE)
        else:
            self.desk.not_holder(word.key, self.ports.now_s())
            self.settle()

    def _carry_out(self, order: Order) -> None:
        match order:
            case AskServer() if order.site is Site.ROBOT:
                self.ports.call(Face.GROUP, order.service, order.number, order.payload)
            case AskServer():
                token = self._token(order)
                word = CallWord(Face.GROUP, order.service, order.number, token, order.standby, order.payload)
                self.post.write(word)
            case Reply():
                self._close(order.caller)
                self.ports.answer_call(Face.PUBLIC, order.service, order.caller, order.payload)
            case Fail():
                self._close(order.caller)
                self.counters[f"{order.service}.{order.why.value}"] += 1
                self.ports.fail_call(
                    Face.PUBLIC, order.service, order.caller, order.why.value, SENTENCES[order.why]
                )  # fmt: skip

    def _close(self, caller: bytes) -> None:
        if self.calls.pop(caller, None) is not None:
            self.keep(journal.call_closed(caller))

    def _token(self, order: AskServer) -> Token:
        view = self.view()
        if self.desk.services[order.service].of_cloud:
            return view.present or NOBODY
        return (view.standby or NOBODY) if order.standby else view.holding.token

    # -- levels -------------------------------------------------------------------------------------------------------

    def due_s(self) -> float:
        """Return when `settle` has something to do."""
        return self.desk.due_s()

    def idle(self) -> bool:
        """Return whether no call is open."""
        return not self.desk.requests
