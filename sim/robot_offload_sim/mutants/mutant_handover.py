# ruff: noqa: E501 - one edit a line
"""The planted faults of goals and calls (letter N: nothing lost); see `mutant_list.py`."""

from __future__ import annotations

from robot_offload_sim.mutants.mutants import Edit, Mutant

HANDOVER: dict[str, Mutant] = {
    "N1": Mutant(
        "result taken from the old side",
        "nodes_rest_after_their_goals",
        (
            Edit(
                "relay.goals.machine",
                "counts = _counts(work, goal, attempt) or (goal.cancel and attempt.site is work.acts(goal)[0])",
                "counts = True",
            ),
        ),
    ),
    "N2": Mutant(
        "changeover before the goals are accepted",
        "goal_that_the_candidate_rejects",
        (
            Edit(
                "control.robot.readiness",
                "return preparation.need or impatient or pending(robot, preparation, without_state=without_state) is None",
                "return True",
            ),
        ),
    ),
    "N3": Mutant(
        "feedback of the standby passes",
        "copy_before_the_change",
        (
            Edit(
                "relay.goals.questions",
                "return goal if copy is not None and copy.id == attempt else None",
                "return goal",
            ),
        ),
    ),
    "N4": Mutant(
        "a cancel while a side gets ready is lost",
        "cancel_in_a_change",
        (
            Edit(
                "relay.goals.machine",
                "work.put(replace(goal, cancel=True, status=GoalStatus.CANCELING))",
                "work.put(replace(goal, cancel=work.view.candidate is None, status=GoalStatus.CANCELING))",
            ),
        ),
    ),
    "N5": Mutant(
        "requests admitted after the lease",
        "request_after_the_lease",
        (
            Edit(
                "relay.cloud",
                "return egress is not None and lease.leaves(egress, self.ports.now_s()) == token",
                "return egress is not None and egress.token in (token, None)",
            ),
        ),
    ),
    "N6": Mutant(
        "the same goal id again",
        "goal_over_twenty_changes",
        (
            Edit(
                "relay.goals.work",
                "attempt_id(self.ledger.incarnation, self.count())",
                "attempt_id(self.ledger.incarnation, goal.order)",
            ),
        ),
    ),
    "N7": Mutant(
        "a new goal goes to the holder only while a side gets ready",
        "goal_between_arming_and_flip",
        (
            Edit(
                "relay.goals.attempts",
                "        and spec.core\n        and not goal.cancel",
                "        and spec.core\n        and work.now_s - goal.need_s > 1.0\n        and not goal.cancel",
            ),
        ),
    ),
    "N8": Mutant(
        "goals offered in another order",
        "preempted_copies",
        (
            Edit(
                "relay.goals.attempts",
                "    for goal in work.live():\n        mirror = _mirror_at(work, goal)",
                "    for goal in reversed(list(work.live())):\n        mirror = _mirror_at(work, goal)",
            ),
        ),
    ),
    "N9": Mutant(
        "a preempted copy is offered again",
        "preempted_copies",
        (Edit("relay.goals.attempts", "    if not preempted(work.seen(), goal, site, token):", "    if True:"),),
    ),
    "N10": Mutant(
        "`Holder` asked again after a lost session",
        "calls_at_a_loss",
        (
            Edit(
                "relay.goals.requests",
                "again = spec.mode in (ServiceMode.IDEMPOTENT, ServiceMode.RACE)",
                "again = True",
            ),
        ),
    ),
    "N11": Mutant(
        "`Both` played before activation",
        "both_before_the_change",
        (
            Edit(
                "relay.goals.requests",
                "return reachable and site in view.able and (site, service) in view.up",
                "return reachable",
            ),
        ),
    ),
    "N12": Mutant(
        "a standby's call at a used name admitted",
        "used_calls_of_the_holder",
        (Edit("relay.goals.used", "return Admission.REFUSE", "return Admission.ADMIT"),),
    ),
    "N13": Mutant(
        "used calls of the robot while the cloud may act",
        "used_calls_after_a_loss",
        (
            Edit(
                "relay.goals.used",
                "return Admission.ADMIT if effects is site else Admission.WAIT",
                "return Admission.ADMIT",
            ),
        ),
    ),
    "N14": Mutant(
        "a letter taken twice",
        "calls_on_a_bad_link",
        (Edit("relay.goals.courier", "        if frame.number in self.taken:\n            return None\n", ""),),
    ),
    "N15": Mutant(
        "letters written once",
        "calls_on_a_bad_link",
        (Edit("relay.goals.courier", "RESEND_S = 0.1", "RESEND_S = 1e9"),),
    ),
    "N16": Mutant(
        "attempts of an ended token run on",
        "goal_after_a_loss",
        (Edit("relay.cloud", "ORPHAN_S = 1.0", "ORPHAN_S = 1e9"),),
    ),
    "N17": Mutant(
        "CANCELED for a client that cancelled nothing",
        "cancelled_by_somebody_else",
        (
            Edit("relay.goals.machine", "if event.status is GoalStatus.CANCELED and not goal.cancel:", "if False:"),
            Edit(
                "relay.goals.machine",
                '            (goal.cancel or goal.status is not GoalStatus.CANCELED, "CANCELED, and no client asked for it"),\n',
                "",
            ),
        ),
    ),
    "N18": Mutant(
        "the stay is not in the journal",
        "change_without_a_relay",
        (Edit("relay.goals.journal", "holding = said.holding or ledger.holding", "holding = ledger.holding"),),
    ),
    "N19": Mutant(
        "attempts are not in the journal",
        "robots_relay_dies",
        (Edit("relay.goals.journal", "elif was is not goal and _goal(was) != _goal(goal):", "elif False:"),),
    ),
    "N20": Mutant(
        "an offer waits for its answer for ever",
        "no_answer_to_an_offer",
        (Edit("relay.goals.attempts", "    if work.now_s >= work.offers_until_s(goal):", "    if False:"),),
    ),
    "N21": Mutant(
        "a late copy of an offer given up runs on",
        "late_acceptance",
        (
            Edit(
                "relay.goals.executor",
                "        self.report(OfferAnswered(attempt, True))\n        self._ask_to_cancel(attempt, run)",
                "        self.report(OfferAnswered(attempt, True))",
            ),
            Edit("relay.goals.executor", "if run.cancel_due_s <= now_s:", "if False:"),
        ),
    ),
    "N22": Mutant(
        "a server's restart is not noticed",
        "forgotten_goal",
        (
            Edit(
                "relay.goals.executor",
                "changed = {name for name, endpoints in before.items() if seen.get(name) != endpoints}",
                "changed = set()",
            ),
        ),
    ),
    "N23": Mutant(
        "a copy that ended first is not offered again",
        "copy_ends_first",
        (Edit("relay.goals.state", "RETRY_S = 0.5", "RETRY_S = 1e9"),),
    ),
    "N24": Mutant(
        "nodes deactivated before their goals have ended",
        "nodes_rest_after_their_goals",
        (Edit("control.nodes.rest", "return status.busy or (unheard and bool(status.executing))", "return False"),),
    ),
    "N25": Mutant(
        "a change does not wait for `Hold` goals",
        "change_waits_for_hold",
        (
            Edit("control.robot.readiness", "return _held(robot, now_s), True", "return _held(robot, now_s), False"),
            Edit(
                "control.robot.readiness",
                "return robot, report is not None and now_s - held_s < report.hold_for_s",
                "return robot, False",
            ),
        ),
    ),
    "N56": Mutant(
        "a planned switch waits for no `ResendOnLoss` goal",
        "planned_switch_costs_no_goal",
        (Edit("relay.goals.attempts", "if starves or spec.on_switch is OnSwitch.RESEND_ON_LOSS", "if starves"),),
    ),
    "N57": Mutant(
        "a goal begins anew at each change, however often",
        "long_goal_between_short_outages",
        (Edit("relay.goals.attempts", "MOST_MOVES = 2", "MOST_MOVES = 1000"),),
    ),
    "N58": Mutant(
        "a goal that names a place keeps its side",
        "goal_that_names_a_place",
        (
            Edit(
                "relay.goals.attempts",
                "spec.on_switch is OnSwitch.RESEND and not spec.mirror and goal.moves",
                "goal.moves",
            ),
        ),
    ),
    "N26": Mutant(
        "`Abort` goals executed on the other side",
        "goals_that_must_not_be_repeated",
        (
            Edit(
                "relay.goals.machine",
                "elif offered and not work.spec(goal).on_switch.resends:",
                "elif False:",
            ),
        ),
    ),
    "N27": Mutant(
        "a success before the change is thrown away",
        "goal_that_ends_in_the_change",
        (
            Edit(
                "relay.goals.machine",
                "return attempt.site is Site.CLOUD and held and same_control and event.under_lease",
                "return False",
            ),
        ),
    ),
    "N28": Mutant(
        "waits for goals for ever, whoever asked",
        "pin_does_not_wait_for_ever",
        (
            Edit(
                "control.robot.readiness",
                "(wish.reason.urgent and now_s >= preparation.patient_until_s)",
                "False",
            ),
        ),
    ),
    "N29": Mutant(
        "a new relay in the cloud is not asked for what runs",
        "clouds_relay_dies",
        (Edit("relay.robot", "                self.step(state.Replaced(Site.CLOUD))\n", ""),),
    ),
    "N30": Mutant(
        "the robot's relay does not ask again for what runs",
        "robots_relay_dies",
        (Edit("relay.robot", "            self.step(state.Replaced())\n", "            pass\n"),),
    ),
    "N31": Mutant(
        "`Both` is not played after a loss",
        "both_after_a_loss",
        (Edit("relay.goals.requests", "sites = [view.holding.site]", "sites: list[Site] = []"),),
    ),
    "N32": Mutant(
        "the old side's goal at a used action runs on",
        "used_goal_over_a_change",
        (Edit("relay.goals.used_goals", "if goal.stay != view.holding.stay and not goal.spec.of_cloud:", "if False:"),),
    ),
    "N33": Mutant(
        "a candidate's goal at a used action is offered before the change",
        "used_goal_over_a_change",
        (Edit("relay.goals.used_goals", "if admission is Admission.WAIT or goal.spec.name", "if goal.spec.name"),),
    ),
    "N34": Mutant(
        "the old side's goal at a used action ends before it has a successor",
        "used_goal_over_a_change",
        (Edit("relay.goals.used_goals", "            if self._followed(goal, view):\n", "            if True:\n"),),
    ),
    "N35": Mutant(
        "a new relay on the robot ends the goals of the cloud at used actions",
        "relays_die_with_used_goals",
        (Edit("relay.goals.used_goals", "goal.site is Site.CLOUD and goal.relay != relay", "goal.site is Site.CLOUD"),),
    ),
    "N36": Mutant(
        "mirrors are cancelled at a closed egress",
        "mirror_in_the_cloud",
        (
            Edit(
                "relay.cloud",
                "max(self.ends.get(run.token, 0.0) + ORPHAN_S, run.named_until_s)",
                "self.ends.get(run.token, 0.0) + ORPHAN_S",
            ),
        ),
    ),
    "N37": Mutant(
        "a mirror is not taken for the copy of the side that gets ready",
        "mirror_over_changes",
        (Edit("relay.goals.attempts", "    if work.spec(goal).mirror:\n", "    if False:\n"),),
    ),
    "N38": Mutant(
        "a mirror that ended is begun again beside its goal",
        "mirror_ends_early",
        (
            Edit(
                "relay.goals.attempts",
                "if _adopt(work, goal, site, token) or any(_ended_itself(a, site) for a in goal.attempts):",
                "if _adopt(work, goal, site, token):",
            ),
        ),
    ),
    "N39": Mutant(
        "a node with placement Cloud counts as reachable without its cloud",
        "node_of_the_cloud_serves",
        (
            Edit(
                "relay.goals.questions",
                "return view.present is not None and view.heard and (Site.CLOUD, name) in view.up",
                "return view.present is not None",
            ),
        ),
    ),
    "N40": Mutant(
        "a side that was called off for its goals is put to sleep at once",
        "called_off_side_settles",
        (
            Edit(
                "control.cloud.lease",
                "prepared = before.lease.granted and before.ready and not before.lease.in_charge",
                "prepared = False",
            ),
        ),
    ),
    "N41": Mutant(
        "goals that are pending end a stay",
        "copy_before_the_change",
        (
            Edit(
                "control.robot.switcher",
                "    fault = _fault(robot, now_s, acting=True)\n    if fault is not None:\n        return changeovers.take",
                "    fault = _fault(robot, now_s, acting=True) or (robot.preparation and readiness.pending(robot, robot.preparation))\n    if fault is not None:\n        return changeovers.take",
            ),
        ),
    ),
    "N42": Mutant(
        "an older snapshot is taken",
        "state_on_a_bad_link",
        (
            Edit(
                "topics.snapshots",
                "if same and (opened.token.epoch, opened.sequence) <= (standing.epoch, standing.sequence):",
                "if False:",
            ),
        ),
    ),
    "N43": Mutant(
        "a torn snapshot is taken",
        "state_on_a_bad_link",
        (
            Edit(
                "topics.snapshots",
                "    if len(data) != size or zlib.crc32(data) != checksum:\n",
                "    if len(data) != size:\n",
            ),
        ),
    ),
    "N44": Mutant(
        "a change does not wait for the state",
        "state_grows_old_in_a_preparation",
        (
            Edit(
                "control.robot.readiness",
                "pending(robot, preparation, without_state=without_state)",
                "pending(robot, preparation, without_state=True)",
            ),
        ),
    ),
    "N45": Mutant(
        "a new relay of the cloud leaves its predecessor's goals alone",
        "clouds_relay_dies_unheard",
        (Edit("relay.cloud", "        self._cancel_inherited(now_s)\n", ""),),
    ),
    "N46": Mutant(
        "the other side's nodes wake before there is state to wake with",
        "first_change_waits_for_state",
        (Edit("control.robot.readiness", "    if lacks is None or wish.reason.kind is Kind.VETO:", "    if True:"),),
    ),
    "N47": Mutant(
        "a person waits for state before a change for ever",
        "person_waits_for_state_once",
        (
            Edit(
                "control.robot.readiness", "bounded = wish.site is Site.ROBOT or wish.reason.urgent", "bounded = False"
            ),
        ),
    ),
    "N48": Mutant(
        "a person waits for state twice",
        "person_waits_for_state_once",
        (
            Edit(
                "control.robot.readiness",
                "without_state = wish.reason.urgent and _waited_out(robot, wish, now_s)",
                "without_state = False",
            ),
        ),
    ),
    "N49": Mutant(
        "a veto waits for state",
        "veto_waits_for_no_state",
        (
            Edit(
                "control.robot.readiness",
                "    if lacks is None or wish.reason.kind is Kind.VETO:",
                "    if lacks is None:",
            ),
        ),
    ),
    "N50": Mutant(
        "state that was published counts as state that the node has",
        "first_change_waits_for_the_reader",
        (Edit("data.states", "given is not reading.had and self.ports.has(name)", "given is not reading.had"),),
    ),
    "N51": Mutant(
        "a change waits for ever for a node that takes no state",
        "node_that_listens_to_nothing",
        (Edit("data.states", "since_s is not None and now_s - since_s < READ_S", "since_s is not None"),),
    ),
    "N52": Mutant(
        "a relay that was replaced counts as one that executed nothing",
        "relay_dies_between_execution_and_answer",
        (
            Edit(
                "relay.goals.requests",
                "ask.fate is Fate.OPEN and ask.stay != stay:\n                    ask.fate = Fate.UNKNOWN",
                "ask.fate is Fate.OPEN and ask.stay != stay:\n                    ask.fate = Fate.NOT_HOLDER",
            ),
        ),
    ),
    "N53": Mutant(
        "a copy is offered under the token of the side that still acts",
        "copy_before_the_change",
        (
            Edit(
                "relay.goals.attempts",
                "    if not preempted(work.seen(), goal, site, token):\n        _offer(work, goal, site, token)",
                "    if not preempted(work.seen(), goal, site, token):\n        _offer(work, goal, site, work.holding.token)",
            ),
        ),
    ),
    "N54": Mutant(
        "a snapshot that waited is said to be new",
        "snapshots_that_waited",
        (Edit("data.states", "heard.echo_us(waited_s)) if heard", "heard.sent_us) if heard"),),
    ),
    "N55": Mutant(
        "a new relay of the cloud trusts a robot that does not know it to name its predecessor's goals",
        "clouds_relay_dies_and_robot_hears_nobody",
        (
            Edit(
                "relay.cloud",
                "            if met:\n",
                "            if met:\n                self.inherited.clear()\n",
            ),
        ),
    ),
}
