"""The robot relay's part about services: clients' calls at served ones, the group's calls at used ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from robot_offload_core.ledger import journal
from robot_offload_core.ledger.goals import View
from robot_offload_core.ledger.ports import Face, RobotRelayPorts
from robot_offload_core.ledger.requests import SENTENCES, AskServer, Desk, Fail, Failure, Order, Reply
from robot_offload_core.ledger.used import UsedCall, UsedCalls, Verdicts
from robot_offload_core.ledger.words import CalledWord, CallWord, Verdict
from robot_offload_core.process.messages import RelayOrders
from robot_offload_core.process.relay import MAX_PAYLOAD, RelayPlan
from robot_offload_core.process.relay_post import Post
from robot_offload_core.token import Site, Token


class RobotRequests:
    """See the module.

    Attributes:
        desk: requests at served services. used: calls of the group at services outside.
        calls: open calls of clients, caller -> service. orders: of control.
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
        self.used = UsedCalls(plan.used_services)
        self.calls: dict[bytes, str] = {}
        self.orders: RelayOrders | None = None
        self.number = 0

    def fail_open(self, calls: dict[bytes, str]) -> None:
        """Fails the calls that a predecessor had open: nobody knows whether they were executed."""
        for caller, service in calls.items():
            if service in self.desk.services:
                self._carry_out(Fail(service, caller, Failure.RELAY_RESTARTED))

    def settle(self) -> None:
        """Lets the desk and the used calls decide under the present view."""
        now_s, view = self.ports.now_s(), self.view()
        if not view.heard and view.holding.site is Site.ROBOT:
            self.desk.lost(Site.CLOUD)
        for order in self.desk.settle(view, now_s):
            self._carry_out(order)
        effects = self.orders.effects if self.orders is not None else None
        for call, verdict in self.used.settle(view, effects, now_s):
            self._decide(call, verdict)

    # -- served services ----------------------------------------------------------------------------------------------

    def called(self, name: str, caller: bytes, payload: bytes) -> None:
        """Takes a client's call."""
        if len(payload) > MAX_PAYLOAD:
            self._carry_out(Fail(name, caller, Failure.TOO_LARGE))
            return
        self.calls[caller] = name
        self.keep(journal.call_opened(caller, name))
        for order in self.desk.called(name, caller, payload, self.ports.now_s()):
            self._carry_out(order)
        self.settle()

    def answered(self, number: int, payload: bytes, success: bool) -> None:
        """Takes the answer of a server; the keys of used services are negative."""
        if number < 0:
            self._used_answered(number, payload, success)
            return
        for order in self.desk.answered(number, payload, success):
            self._carry_out(order)
        self.settle()

    def take(self, word: CalledWord) -> None:
        """Takes the cloud relay's answer to an ask."""
        if word.verdict in (Verdict.DONE, Verdict.FAILED):
            self.answered(word.key, word.payload, word.verdict is Verdict.DONE)
        else:
            self.desk.not_holder(word.key, self.ports.now_s())
            self.settle()

    def _carry_out(self, order: Order) -> None:
        match order:
            case AskServer() if order.site is Site.ROBOT:
                self.ports.call(Face.GROUP, order.service, order.number, order.payload)
            case AskServer():
                token = self._standby_token() if order.standby else self.view().holding.token
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

    def _standby_token(self) -> Token:
        orders = self.orders
        return Token(orders.robot, orders.epoch, orders.cloud) if orders is not None else Token("", 0, "")

    # -- used services ------------------------------------------------------------------------------------------------

    def used_here(self, name: str, caller: bytes, payload: bytes) -> None:
        """Takes a call of the robot's group at a service outside."""
        spec = self.used.services[name]
        if len(payload) > MAX_PAYLOAD:
            self._fail_used(UsedCall(spec, Site.ROBOT, None, b"", 0.0, caller), Failure.TOO_LARGE)
            return
        until_s = self.ports.now_s() + spec.timeout_s
        self.used.calls.append(UsedCall(spec, Site.ROBOT, None, payload, until_s, caller))
        self.settle()

    def used_in_cloud(self, word: CallWord) -> None:
        """Takes a call of the cloud's group at a service outside."""
        spec = self.used.services.get(word.service)
        if spec is None:
            self.post.write(CalledWord(Face.PUBLIC, word.key, Verdict.REFUSED, b""))
            return
        until_s = self.ports.now_s() + spec.timeout_s
        self.used.calls.append(UsedCall(spec, Site.CLOUD, word.token, word.payload, until_s, key=word.key))
        self.settle()

    def _decide(self, call: UsedCall, verdict: Verdicts) -> None:
        if verdict is Verdicts.CALL:
            self.number -= 1
            call.number = self.number
            self.ports.call(Face.PUBLIC, call.spec.name, call.number, call.payload)
        elif call.site is Site.CLOUD:
            refused = Verdict.NOT_HOLDER if verdict is Verdicts.REFUSED else Verdict.REFUSED
            self.post.write(CalledWord(Face.PUBLIC, call.key, refused, b""))
        else:
            self._fail_used(call, Failure.REFUSED if verdict is Verdicts.REFUSED else Failure.TIMEOUT)

    def _fail_used(self, call: UsedCall, why: Failure) -> None:
        self.counters[f"{call.spec.name}.{why.value}"] += 1
        self.ports.fail_call(Face.GROUP, call.spec.name, call.caller, why.value, SENTENCES[why])

    def _used_answered(self, number: int, payload: bytes, success: bool) -> None:
        call = self.used.answered(number)
        if call is None:
            return
        if call.site is Site.ROBOT:
            self.ports.answer_call(Face.GROUP, call.spec.name, call.caller, payload)
        else:
            verdict = Verdict.DONE if success else Verdict.FAILED
            self.post.write(CalledWord(Face.PUBLIC, call.key, verdict, payload))

    # -- levels -------------------------------------------------------------------------------------------------------

    def due_s(self) -> float:
        """Returns when `settle` has something to do."""
        return min(self.desk.due_s(), self.used.due_s())

    def idle(self) -> bool:
        """Returns whether no call is open."""
        return not (self.desk.requests or self.used.calls)
