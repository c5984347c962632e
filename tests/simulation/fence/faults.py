"""Faults planted in the fence, one edit each, and the world that must find them."""

from __future__ import annotations

from dataclasses import dataclass

from robot_offload_sim.mutants.mutants import Edit
from tests.simulation.fence.bounds import Bounds
from tests.simulation.fence.cloud_world import CloudWorld
from tests.simulation.fence.gate_world import GateWorld

ONE_LIFE = Bounds(epochs=3, robots=1, clouds=1)
TWO_LIVES = Bounds(epochs=2, robots=2, clouds=1)


@dataclass(frozen=True)
class Fault:
    """A planted fault.

    Attributes:
        meaning: what the edited fence does wrong.
        world: in which it is found. bounds: of that world.
        found: words of the invariant that it breaks.
        edits: one, or two where another rule guards the same.
    """

    meaning: str
    world: type[GateWorld | CloudWorld]
    found: str
    edits: tuple[Edit, ...]
    bounds: Bounds = ONE_LIFE


def _gate(old: str, new: str) -> tuple[Edit, ...]:
    return (Edit("fence.gate", old, new),)


EGRESS_WITHOUT_CLOCK = Edit("fence.lease", "return token if now_s < end_s else None", "return token")
LEASE_WITHOUT_CLOCK = Edit("fence.lease", "return lease.granted and now_s < lease.end_s", "return lease.granted")

FAULTS = {
    "G1": Fault(
        "a stay of the cloud that was left by falling back is entered again", GateWorld, "is heard after",
        _gate("if gate.fell_back and ours.site is Site.CLOUD:", "if False:"),
    ),
    "G2": Fault(
        "an epoch that was left behind is entered again", GateWorld, "is heard after",
        _gate("theirs.token.epoch > ours.token.epoch:", "theirs.token.epoch != ours.token.epoch:"),
    ),
    "G3": Fault(
        "a control process that was replaced is heard", GateWorld, "is heard after",
        _gate("if word.started_us < gate.started_us:", "if False:"), TWO_LIVES,
    ),
    "G4": Fault(
        "a newer token passes in place of an equal one", GateWorld, "is heard after",
        _gate(
            "    if charge == gate.charge:\n",
            "    if gate.charge.site is Site.CLOUD and header.token.epoch >= gate.charge.token.epoch:\n",
        ), Bounds(epochs=4, robots=1, clouds=1),
    ),
    "G5": Fault(
        "age has no bound", GateWorld, "old",
        (Edit("fence.freshness", "return 0 <= age_s <= most_s", "return 0 <= age_s"),),
    ),
    "G6": Fault(
        "what the predecessor of this collector may have passed passes again", GateWorld, "sequence",
        _gate("return gate.resumed_s is not None and header.echo_us / 1e6 <= gate.resumed_s", "return False"),
    ),
    "G7": Fault(
        "a doubled message passes twice", GateWorld, "sequence",
        _gate("if header.sequence <= gate.passed[output]:", "if header.sequence < gate.passed[output]:"),
    ),
    "G8": Fault(
        "the cloud passes after the gate has fallen back", GateWorld, "is heard after",
        _gate(
            "    if gate.fell_back or gate.charge is None or gate.said_s is None:\n        return gate, Ruling",
            "    if gate.charge is None or gate.said_s is None:\n        return gate, Ruling",
        ),
    ),
    "G9": Fault(
        "the gate never falls back", GateWorld, "effects of the robot",
        _gate("if gate.fell_back or spoken_s is None or now_s - spoken_s <= gate.silence_s:", "if True:"),
    ),
    "G10": Fault(
        "a word of control counts from its arrival", GateWorld, "effects of the robot",
        _gate("said_s=min(word.said_s, now_s)", "said_s=now_s"),
    ),
    "G11": Fault(
        "a side with two producers passes", GateWorld, "although",
        _gate("if not known.single:", "if False:"),
    ),
    "G12": Fault(
        "beside another publisher a side passes", GateWorld, "although",
        _gate("if not known.alone:", "if False:"),
    ),
    "G13": Fault(
        "bytes of another type pass", GateWorld, "although",
        _gate("return None if known.types_equal else Ruling.TYPES_DIFFER", "return None"),
    ),
    "G14": Fault(
        "a changeover forgets which messages it has taken", GateWorld, "sequence",
        _gate("fell_back=False, passed=_sequences(gate))\n\n\ndef _enter", "fell_back=False)\n\n\ndef _enter"),
    ),
    "G15": Fault(
        "a held message is released twice", GateWorld, "sequence",
        _gate("return _hold(gate, output, None), passes", "return gate, passes"),
    ),
    "G16": Fault(
        "a held message is released behind a newer one", GateWorld, "sequence",
        _gate("replace(_hold(gate, output, None), passed=passed)", "replace(gate, passed=passed)"),
    ),
    "G17": Fault(
        "a held message is released whatever its age", GateWorld, "old",
        _gate("_fault(known) is None and fresh(now_s - held.born_s, gate.max_age_s)", "_fault(known) is None"),
    ),
    "G18": Fault(
        "the record forgets that the gate had fallen back", GateWorld, "is heard after",
        (Edit("fence.memory", "str(int(gate.fell_back))", '"0"'),),
    ),
    "R1": Fault(
        "effects of the robot are clear before a lease has ended", CloudWorld, "effects of the robot",
        (Edit("fence.grant", "now_s < grant.clear_s", "now_s + 1 < grant.clear_s"),),
    ),
    "R2": Fault(
        "the robot takes over under the epoch for which the cloud got ready", GateWorld, "effects of the robot",
        (Edit("fence.grant", "    epoch = grant.last_epoch + 1\n", "    epoch = grant.epoch + 1\n"),),
    ),
    "R3": Fault(
        "effects of the robot are admitted while the gate may change over", GateWorld, "effects of the robot",
        (Edit("fence.grant", "grant.offered or now_s", "now_s"),),
    ),
    "R4": Fault(
        "calling off a preparation of the cloud keeps the robot's epoch", GateWorld, "effects of the robot",
        (
            Edit(
                "fence.grant", "    if grant.site is Site.ROBOT:\n        return take_over",
                "    if False:\n        return take_over",
            ),
        ),
    ),
    "R5": Fault(
        "after a takeover effects of the robot are clear at once", CloudWorld, "effects of the robot",
        (Edit("fence.grant", "offered=False, clear_s=now_s + stopped_s", "offered=False"),),
    ),
    "R6": Fault(
        "a new control takes the leases of its predecessor for ended", CloudWorld, "effects of the robot",
        (Edit("fence.grant", "return Grant(robot, now_s + stopped_s)", "return Grant(robot, now_s)"),), TWO_LIVES,
    ),
    "L1": Fault(
        "a lease counts from the arrival of its grant", CloudWorld, "not permitted for a lease",
        (Edit("fence.lease", "end_s = heard.echo_s + heard.length_s", "end_s = now_s + heard.length_s"),),
    ),
    "L2": Fault(
        "another robot is served while a lease is held", CloudWorld, "another robot",
        (Edit("fence.lease", "robot == lease.robot or holds(lease, now_s)", "robot == lease.robot"),), TWO_LIVES,
    ),
    "L3": Fault(
        "a grant of an older epoch renews the newer one", CloudWorld, "not permitted for a lease",
        (Edit("fence.lease", " or token.epoch < lease.epoch:", ":"),),
    ),
    "L4": Fault(
        "an epoch that is named without a grant takes over the lease of the one before", CloudWorld,
        "not permitted for a lease",
        (Edit("fence.lease", "epoch=token.epoch, granted=False, in_charge=False, end_s=0.0", "epoch=token.epoch"),),
    ),
    "L5": Fault(
        "a grant that is addressed to another cloud counts", CloudWorld, "not permitted for a lease",
        (Edit("fence.lease", " or token.cloud != lease.cloud", ""),), Bounds(epochs=2, robots=1, clouds=2),
    ),
    "L6": Fault(
        "the egress lets messages leave after the end of a lease", CloudWorld, "not permitted for a lease",
        (EGRESS_WITHOUT_CLOCK,),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class SecondGuard:
    """A rule that another one guards too: without it nothing breaks, without both something does."""

    meaning: str
    world: type[GateWorld | CloudWorld]
    edit: Edit
    twin: Edit


SECOND_GUARDS = {
    "S1": SecondGuard(
        "the cloud's control believes in a lease that has ended; the egress looks at the clock by itself", CloudWorld,
        LEASE_WITHOUT_CLOCK, EGRESS_WITHOUT_CLOCK,
    ),
    "S2": SecondGuard(
        "what is no newer than the side in charge may follow; control never says such a word", GateWorld,
        Edit("fence.gate", "following is not None and following.token.epoch <= gate.charge.token.epoch:", "False:"),
        Edit("fence.gate", "if theirs.token.epoch < ours.token.epoch:", "if False:"),
    ),
}  # fmt: skip
