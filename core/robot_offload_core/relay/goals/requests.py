"""The robot relay's requests at served services: which side is asked, which is asked again, what the caller gets.

A request lives until its caller was answered or given up. Each time a side is asked is an *ask* with its own number.
Only if the other relay answered `NotHolder` is it certain that an ask executed nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.goals.questions import there
from robot_offload_core.relay.goals.state import ASK_AGAIN_S, View
from robot_offload_core.words.declared import ServiceMode, ServiceSpec

MAX_WAITING = 64
"""Most requests of one service that wait for a holder; a further one fails at once."""


class Fate(Enum):
    """What became of an ask."""

    OPEN = 1
    NOT_HOLDER = 2
    """Certainly not executed."""
    UNKNOWN = 3
    """Perhaps executed: its session ended, its relay was replaced, or it took too long."""
    DONE = 4


class Failure(str, Enum):
    """Why a caller gets no answer from a server."""

    UNKNOWN = "Unknown"
    TIMEOUT = "Timeout"
    TOO_MANY = "TooManyWaiting"
    TOO_LARGE = "TooLarge"
    REFUSED = "Standby"
    RELAY_RESTARTED = "RelayRestarted"
    CLOUD_AWAY = "CloudAway"


SENTENCES = {
    Failure.UNKNOWN: "it is not known whether the call was executed: its side went away; look, then ask again",
    Failure.TIMEOUT: "no side answered in time; look whether the service's node is Active",
    Failure.TOO_MANY: "too many calls wait for a side that can execute them; call less often",
    Failure.TOO_LARGE: "the request is larger than 1 MiB; send less at once",
    Failure.REFUSED: "this side is standby: only the side that acts may call; nothing needs to be done",
    Failure.RELAY_RESTARTED: "the agent's relay was started again while the call was open; look, then ask again",
    Failure.CLOUD_AWAY: "the cloud is away, and only its node can answer; ask again when /offload/available says so",
}


@dataclass
class Ask:
    """One request to one side. `stay`: the holder's stay then. `standby`: sent so that the replica changes too."""

    number: int
    site: Site
    stay: int
    until_s: float
    standby: bool = False
    fate: Fate = Fate.OPEN


@dataclass
class Request:
    """A call of a client. `until_s`: end of its wait for a holder. `retry_s`: earliest next ask."""

    spec: ServiceSpec
    caller: bytes
    payload: bytes
    until_s: float
    retry_s: float = 0.0
    asks: list[Ask] = field(default_factory=list)


@dataclass(frozen=True)
class AskServer:
    """Order: call a side's server."""

    number: int
    site: Site
    service: str
    payload: bytes
    standby: bool


@dataclass(frozen=True)
class Reply:
    """Order: answer a caller."""

    service: str
    caller: bytes
    payload: bytes


@dataclass(frozen=True)
class Fail:
    """Order: fail a call without a server's answer."""

    service: str
    caller: bytes
    why: Failure


Order = AskServer | Reply | Fail


@dataclass
class Replay:
    """The newest request of a `Both` service, and the version that each side has executed.

    Attributes:
        version: number of requests so far.
        played: the newest version that a side has executed.
        open: number of the ask that a side has not answered yet.
        failed: sides that refused the newest request.
    """

    payload: bytes = b""
    version: int = 0
    played: dict[Site, int] = field(default_factory=dict)
    open: dict[Site, tuple[int, int]] = field(default_factory=dict)
    failed: set[Site] = field(default_factory=set)


class Desk:
    """All requests of the served services.

    Attributes:
        services: by public name.
        requests: open ones, in order.
        replays: of services with mode `Both`.
        counter: number of asks so far.
    """

    def __init__(self, services: tuple[ServiceSpec, ...]) -> None:
        self.services = {spec.name: spec for spec in services}
        self.requests: list[Request] = []
        self.replays = {spec.name: Replay() for spec in services if spec.mode is ServiceMode.BOTH}
        self.counter = 0

    # -- what happens -------------------------------------------------------------------------------------------------

    def called(self, service: str, caller: bytes, payload: bytes, now_s: float) -> list[Order]:
        """Take a client's call."""
        spec = self.services[service]
        waiting = sum(1 for r in self.requests if r.spec.name == service and not _open(r))
        if waiting >= MAX_WAITING:
            return [Fail(service, caller, Failure.TOO_MANY)]
        self.requests.append(Request(spec, caller, payload, now_s + spec.timeout_s))
        replay = self.replays.get(service)
        if replay is not None:
            replay.payload, replay.version = payload, replay.version + 1
            replay.failed.clear()
        return []

    def answered(self, number: int, payload: bytes, success: bool) -> list[Order]:
        """Take an answer; it counts until the caller has one, however late."""
        self._note_played(number, success)
        request, ask = self._find(number)
        if request is None or ask is None:
            return []
        ask.fate = Fate.DONE
        if ask.standby and request.spec.mode is not ServiceMode.RACE:
            return []
        self.requests.remove(request)
        return [Reply(request.spec.name, request.caller, payload)]

    def not_holder(self, number: int, now_s: float) -> None:
        """Record that an ask certainly executed nothing."""
        for replay in self.replays.values():
            replay.open = {site: ask for site, ask in replay.open.items() if ask[0] != number}
        request, ask = self._find(number)
        if request is not None and ask is not None and ask.fate is Fate.OPEN:
            ask.fate = Fate.NOT_HOLDER
            request.retry_s = now_s + ASK_AGAIN_S

    def lost(self, site: Site, stay: int | None = None) -> None:
        """Mark a side's open requests as lost, except those of stay `stay`."""
        for request in self.requests:
            for ask in request.asks:
                if ask.site is site and ask.fate is Fate.OPEN and ask.stay != stay:
                    ask.fate = Fate.UNKNOWN
        for replay in self.replays.values():
            replay.open.pop(site, None)

    def lost_server(self, site: Site, service: str) -> None:
        """Mark the calls of a side's server that is gone as lost."""
        for request in self.requests:
            for ask in request.asks:
                if request.spec.name == service and ask.site is site and ask.fate is Fate.OPEN:
                    ask.fate = Fate.UNKNOWN
        if service in self.replays:
            self.replays[service].open.pop(site, None)

    # -- what must be -------------------------------------------------------------------------------------------------

    def settle(self, view: View, now_s: float) -> list[Order]:
        """Ask the sides that may be asked; give up what took too long."""
        orders: list[Order] = []
        for request in list(self.requests):
            orders += self._settle(request, view, now_s)
        for name, replay in self.replays.items():
            orders += self._play(name, replay, view, now_s)
        return orders

    def _settle(self, request: Request, view: View, now_s: float) -> list[Order]:
        holding, spec = view.holding, request.spec
        if spec.of_cloud:
            return self._settle_of_cloud(request, view, now_s)
        for ask in request.asks:
            if ask.fate is Fate.OPEN and now_s >= ask.until_s:
                ask.fate = Fate.UNKNOWN
        asks = [ask for ask in request.asks if not ask.standby]
        if any(ask.fate is Fate.OPEN for ask in asks):
            return self._race(request, view, now_s)
        unknown = [ask for ask in asks if ask.fate is Fate.UNKNOWN]
        if unknown:
            elsewhere = all(ask.stay != holding.stay for ask in unknown)
            again = spec.mode in (ServiceMode.IDEMPOTENT, ServiceMode.RACE)
            if not (again and elsewhere):
                return self._give_up(request, Failure.UNKNOWN)
        if now_s >= request.until_s and not unknown:
            return self._give_up(request, Failure.TIMEOUT)
        if now_s < request.retry_s or not able(view, holding.site, spec.name):
            late = bool(unknown) and now_s >= max(ask.until_s for ask in unknown) + spec.timeout_s
            return self._give_up(request, Failure.UNKNOWN) if late else []
        return [*self._ask(request, holding.site, holding.stay, False, now_s), *self._race(request, view, now_s)]

    def _settle_of_cloud(self, request: Request, view: View, now_s: float) -> list[Order]:
        """Settle a request at a node with placement Cloud: ask it whichever side holds; fail while it is away."""
        executed = any(ask.fate is Fate.UNKNOWN or now_s >= ask.until_s for ask in request.asks)
        asked = any(ask.fate is Fate.OPEN for ask in request.asks)
        if executed or (asked and not there(view, request.spec.name)):
            return self._give_up(request, Failure.UNKNOWN)
        if not there(view, request.spec.name):
            return self._give_up(request, Failure.CLOUD_AWAY)
        if now_s >= request.until_s:
            return self._give_up(request, Failure.TIMEOUT)
        if asked or now_s < request.retry_s:
            return []
        return self._ask(request, Site.CLOUD, view.holding.stay, False, now_s)

    def _race(self, request: Request, view: View, now_s: float) -> list[Order]:
        """Ask the standby too: the first answer wins."""
        other = view.holding.site.other
        if request.spec.mode is not ServiceMode.RACE or any(ask.standby for ask in request.asks):
            return []
        if other not in request.spec.hot or not able(view, other, request.spec.name):
            return []
        return self._ask(request, other, view.holding.stay, True, now_s)

    def _ask(self, request: Request, site: Site, stay: int, standby: bool, now_s: float) -> list[Order]:
        self.counter += 1
        request.asks.append(Ask(self.counter, site, stay, now_s + request.spec.timeout_s, standby))
        replay = self.replays.get(request.spec.name)
        if replay is not None and request.payload == replay.payload:
            replay.open[site] = (self.counter, replay.version)
        return [AskServer(self.counter, site, request.spec.name, request.payload, standby)]

    def _give_up(self, request: Request, why: Failure) -> list[Order]:
        self.requests.remove(request)
        return [Fail(request.spec.name, request.caller, why)]

    def _find(self, number: int) -> tuple[Request | None, Ask | None]:
        for request in self.requests:
            for ask in request.asks:
                if ask.number == number:
                    return request, ask
        return None, None

    # -- Both ---------------------------------------------------------------------------------------------------------

    def _play(self, name: str, replay: Replay, view: View, now_s: float) -> list[Order]:
        """Have the newest request executed where it was not: on a Hot standby, on the candidate, after a change."""
        orders: list[Order] = []
        for site in self._listeners(name, view):
            stale = replay.played.get(site, 0) < replay.version
            if not stale or site in replay.open or site in replay.failed or not able(view, site, name):
                continue
            if any(r.spec.name == name and r.payload == replay.payload for r in self.requests) and (
                site is view.holding.site
            ):
                continue  # the holder gets it as the caller's own request
            self.counter += 1
            replay.open[site] = (self.counter, replay.version)
            orders.append(AskServer(self.counter, site, name, replay.payload, site is not view.holding.site))
        return orders

    def _listeners(self, name: str, view: View) -> list[Site]:
        sites = [view.holding.site]
        candidate = view.candidate[0] if view.candidate is not None else None
        other = view.holding.site.other
        if other is candidate or other in self.services[name].hot:
            sites.append(other)
        return sites

    def _note_played(self, number: int, success: bool) -> None:
        for replay in self.replays.values():
            for site, (open_number, version) in list(replay.open.items()):
                if open_number == number:
                    del replay.open[site]
                    if success:
                        replay.played[site] = max(version, replay.played.get(site, 0))
                    else:
                        replay.failed.add(site)

    def diverged(self, view: View) -> tuple[str, ...]:
        """Return the `Both` services whose newest request the candidate has not executed."""
        if view.candidate is None or view.candidate[0] is view.holding.site:
            return ()
        site = view.candidate[0]
        return tuple(sorted(n for n, r in self.replays.items() if r.played.get(site, 0) < r.version))

    def refused(self, view: View) -> tuple[str, ...]:
        """Return the `Both` services whose newest request the active side has refused."""
        site = view.holding.site
        found = (n for n, r in self.replays.items() if site in r.failed and r.played.get(site, 0) < r.version)
        return tuple(sorted(found))

    def busy(self, site: Site) -> bool:
        """Return whether a side has calls to answer."""
        return any(a.site is site and a.fate is Fate.OPEN for r in self.requests for a in r.asks)

    def due_s(self) -> float:
        """Return when `settle` gives something up or may ask again."""
        times = [min([r.until_s, *(a.until_s for a in r.asks if a.fate is Fate.OPEN)]) for r in self.requests]
        times += [r.retry_s for r in self.requests if r.retry_s and not _open(r)]
        return min(times, default=float("inf"))


def able(view: View, site: Site, service: str) -> bool:
    """Return whether a side's server can take a call: CORE nodes Active, its own node Active, its server seen."""
    reachable = site is Site.ROBOT or view.heard
    return reachable and site in view.able and (site, service) in view.up


def _open(request: Request) -> bool:
    return any(ask.fate is Fate.OPEN for ask in request.asks)
