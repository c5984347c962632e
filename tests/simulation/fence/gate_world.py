"""The robot's words, the collector's gate and its consumers: what is heard, and in which order.

The cloud is whatever it likes to be within what `cloud_world` shows: under a token a message may leave at any moment
until as long as a lease and the pulse's patience after control last permitted that token. A message's sequence is twice
the tick in which it leaves, or one more: any number of them leave, two in one tick, and sequences are ages too.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace

from robot_offload_core.fence import gate, grant, memory
from robot_offload_core.fence.envelope import Envelope
from robot_offload_core.fence.gate import Charge, Gate, Known, Ruling, Word
from robot_offload_core.fence.token import Site, Token
from tests.simulation.fence.bounds import NOW, Bounds
from tests.simulation.fence.explore import BrokenError
from tests.simulation.fence.robot import Robot, RobotPart, shown

KNOWN = tuple(Known(a, s, t) for a in (True, False) for s in (True, False) for t in (True, False))
"""Every combination of the three predicates; the first one holds."""


@dataclass(frozen=True)
class Heard:
    """What the consumers heard last: the stay (robot's incarnation and twice the epoch), its side, the sequence."""

    stay: tuple[int, int]
    site: Site
    sequence: int = -1


@dataclass(frozen=True)
class Front:
    """The gate, and what its consumers heard last."""

    gate: Gate
    heard: Heard | None


@dataclass(frozen=True)
class Said:
    """What control says to the gate in one of its states."""

    started: int
    current: Charge
    next: Charge | None


class GateWorld:
    """See the module."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
        self.part = RobotPart(bounds, self._speech)
        self.robots = {f"robot{i}": i for i in range(bounds.robots)}

    def _speech(self, robot: Robot) -> dict[Hashable, int]:
        """Return what control may say now; it leaves out what may follow whenever it likes."""
        current, following = grant.current(robot.grant), grant.following(robot.grant)
        words: dict[Hashable, int] = {
            Said(robot.number, current, after): self.bounds.silence + 1 for after in (None, following)
        }
        permission = grant.permission(robot.grant, "")
        if permission.granted:
            words[permission.token] = self.bounds.stopped + self.bounds.age
        return words

    def start(self) -> tuple[Robot, Front]:
        """Return the first state: control has said nothing yet."""
        return self.part.start(), Front(gate.start(1, self.bounds.age, self.bounds.silence), None)

    def robot_moves(self, robot: Robot) -> Iterator[tuple[str, Robot]]:
        """Yield what control may do by itself."""
        return self.part.moves(robot)

    def robot_tick(self, robot: Robot) -> Robot:
        """Return the robot one tick later."""
        return self.part.tick(robot)

    def tells(self, front: Front) -> Charge | None:
        """Return what the gate reports to control."""
        return front.gate.charge

    def told(self, robot: Robot, said: Charge | None) -> Iterator[tuple[str, Robot]]:
        """Yield what control makes of the gate's report."""
        if said is not None:
            yield self.part.reported(robot, said)

    def inputs(self, robot: Robot) -> list[Hashable]:
        """Return what may reach the gate now: words of control, messages of the cloud by token, each with its age."""
        found: list[Hashable] = []
        for said, age in self.part.under_way(robot).items():
            if isinstance(said, Token):
                youngest = max(0, age - self.bounds.stopped + 1)
                found += [(said, sent) for sent in range(youngest, self.bounds.age + 2)]
            else:
                found.append((said, age))
        return found

    def react(self, front: Front, heard: Hashable) -> Iterator[tuple[str, Front]]:
        """Yield the gate after what has reached it."""
        assert isinstance(heard, tuple)
        said, age = heard
        if isinstance(said, Token):
            yield from self._arrives(front, said, age)
            return
        assert isinstance(said, Said)
        word = Word(said.started, said.current, said.next, NOW - age)
        name = f"gate hears {shown(said.current)}, next {shown(said.next)}, {age} old"
        yield name, replace(front, gate=gate.order(front.gate, word, NOW))

    # -- time ---------------------------------------------------------------------------------------------------------

    def _older(self, time: float) -> int:
        """Return a time of the past as it is one tick later."""
        return max(int(time) - 1, NOW - self.bounds.oldest)

    def _lower(self, sequence: int) -> int:
        """Return a sequence as it is one tick later; those below all that may still arrive are alike."""
        return sequence - 2 if sequence - 2 >= 2 * (NOW - self.bounds.age - 1) else -1

    def tick(self, front: Front) -> Front:
        """Return the gate one tick later; it has looked at the clock."""
        state, heard = front.gate, front.heard
        held = state.held[0]
        if held is not None:
            held = replace(held, born_s=self._older(held.born_s), sequence=self._lower(held.sequence))
        state = replace(
            state,
            said_s=None if state.said_s is None else self._older(state.said_s),
            resumed_s=None if state.resumed_s is None else self._older(state.resumed_s),
            held=(held,),
            passed=(self._lower(state.passed[0]),),
        )
        if heard is not None:
            heard = replace(heard, sequence=self._lower(heard.sequence))
        return Front(gate.tick(state, NOW), heard)

    # -- messages -----------------------------------------------------------------------------------------------------

    def _arrives(self, front: Front, token: Token, age: int) -> Iterator[tuple[str, Front]]:
        """Yield the gate after a message of the cloud that left so long ago, with every echo and all that is known."""
        for echo in range(age, self.bounds.age + 2):
            for sequence in (2 * (NOW - age), 2 * (NOW - age) + 1):
                header = Envelope(token, sequence, (NOW - echo) * 1_000_000)
                for known in KNOWN:
                    after, ruling = gate.cloud(front.gate, 0, header, NOW, known)
                    self._refused(ruling, known)
                    heard = self._hear(front, Site.CLOUD, token, sequence) if ruling.passes else front.heard
                    name = f"message {token.epoch}.{sequence % 2} arrives, {age} old, with an echo {echo} old"
                    yield f"{name}: {ruling.value}", Front(after, heard)

    def moves(self, front: Front) -> Iterator[tuple[str, Front]]:
        """Yield what happens at the gate by itself: the robot speaks, the caller changes over or releases, it dies."""
        for known in KNOWN:
            after, ruling = gate.robot(front.gate, 0, NOW, known)
            self._refused(ruling, known)
            heard = self._hear(Front(after, front.heard), Site.ROBOT, None, -1) if ruling.passes else front.heard
            yield f"the robot speaks: {ruling.value}", Front(after, heard)
            yield "gate releases what it held", self._released(front, known)
        yield "gate changes over", replace(front, gate=gate.take_over(front.gate, NOW))
        if front.gate.resumed_s is None:
            yield "collector restarts", self._restarted(front)

    def _refused(self, ruling: Ruling, known: Known) -> None:
        if known != KNOWN[0] and (ruling.passes or ruling is Ruling.NOT_ALL_READY):
            raise BrokenError(f"a message passes or is held although {known}")

    def _released(self, front: Front, known: Known) -> Front:
        held, charge = front.gate.held[0], front.gate.charge
        after, passes = gate.release(front.gate, 0, NOW, known)
        if not passes:
            return Front(after, front.heard)
        if known != KNOWN[0] or held is None or charge is None:
            raise BrokenError(f"a held message passes although {known}, held {held}")
        ours = charge.site is Site.ROBOT
        if ours and NOW - held.born_s > self.bounds.age:
            raise BrokenError(f"a held message of the robot passes that is {NOW - held.born_s} old")
        return Front(after, self._hear(front, charge.site, None if ours else charge.token, held.sequence))

    def _restarted(self, front: Front) -> Front:
        fresh = gate.start(1, self.bounds.age, self.bounds.silence)
        written = memory.write(front.gate, 0)
        record = memory.read(written) if written is not None else None
        if record is not None:
            fresh = gate.resume(fresh, record.charge, record.started_us, record.fell_back, NOW)
        return Front(fresh, front.heard)

    def _hear(self, front: Front, site: Site, token: Token | None, sequence: int) -> Heard:
        """Return what the consumers have heard then; raises BrokenError where they must not hear it."""
        charge, before = front.gate.charge, front.heard
        if token is None:  # the robot's messages carry none: they are of its stay, or of one behind a cloud's
            token = Token("robot0", 0, "") if charge is None else charge.token
            behind = charge is not None and charge.site is Site.CLOUD
            stay = (self.robots[token.robot], 2 * token.epoch + behind)
        else:
            stay = (self.robots[token.robot], 2 * token.epoch)
            if NOW - sequence // 2 > self.bounds.age:
                raise BrokenError(f"a message of the cloud passes that is {NOW - sequence // 2} old")
        if before is not None and stay < before.stay:
            raise BrokenError(f"stay {stay} of the {site.value} is heard after {before.stay}")
        if before is not None and stay == before.stay:
            if site is not before.site:
                raise BrokenError(f"both sides are heard in stay {stay}")
            if site is Site.CLOUD and sequence <= before.sequence:
                raise BrokenError(f"sequence {sequence} is heard after {before.sequence}")
        return Heard(stay, site, sequence)

    def claims(self, robot: Robot) -> bool:
        """Return whether the robot's own effects are admitted."""
        return grant.effects(robot.grant, NOW) is Site.ROBOT

    def check(self, claims: bool, front: Front) -> None:
        """Raise BrokenError where the gate lets the cloud act beside the robot's own effects."""
        charge = front.gate.charge
        if claims and charge is not None and gate.effect(front.gate, charge.token, NOW) is Ruling.CURRENT:
            raise BrokenError("effects of the robot are admitted while the gate lets the cloud act")
