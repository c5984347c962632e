# ruff: noqa: E501 - one edit a line
"""The planted faults: what each does wrong, its edit, and the story that finds it (docs/explanation/simulation.md).

Letters: L lease, P pulse, C collector, S switcher, H health and good beats, W wishes, K links, T settings, E envelope,
M mirror, V vetoes, Y policy, G guardian, X the processes around them. With +: edits that remove a rule and what guards it besides.
"""

from __future__ import annotations

from robot_offload_sim.mutants.mutant_garbage import GARBAGE
from robot_offload_sim.mutants.mutant_handover import HANDOVER
from robot_offload_sim.mutants.mutant_hot import HOT, HOT_EQUIVALENT
from robot_offload_sim.mutants.mutant_while import WHILE
from robot_offload_sim.mutants.mutants import Edit, Equivalent, Mutant

MUTANTS: dict[str, Mutant] = {
    "L1": Mutant(
        "pause does not void old echoes",
        "paused_cloud_control",
        (
            Edit(
                "fence.lease",
                "not lease.void_before_s <= heard.echo_s <= now_s:",
                "not heard.echo_s <= now_s:",
            ),
        ),
    ),
    "L2": Mutant(
        "pause never noticed",
        "paused_cloud_control",
        (Edit("control.cloud.lease", "> cloud.settings.pause_s", "> 1e9"),),
    ),
    "L3": Mutant(
        "takes grants for another cloud",
        "stranger_in_the_echo",
        (
            Edit(
                "fence.lease",
                "token.cloud != lease.cloud or token.epoch < lease.epoch:",
                "token.epoch < lease.epoch:",
            ),
        ),
    ),
    "L5": Mutant(
        "lease carries over to a newer epoch",
        "lease_of_an_ended_epoch",
        (
            Edit(
                "fence.lease",
                "lease = replace(lease, epoch=token.epoch, granted=False, in_charge=False, end_s=0.0)",
                "lease = replace(lease, epoch=token.epoch)",
            ),
        ),
    ),
    "L6": Mutant(
        "second robot served at once",
        "second_robot",
        (
            Edit(
                "control.cloud.lease",
                "if cloud.robot and (now_s - cloud.robot_s <= cloud.settings.robot_live_s or holds_lease(cloud, now_s)):",
                "if False:",
            ),
            Edit("fence.lease", "if robot == lease.robot or holds(lease, now_s):", "if robot == lease.robot:"),
        ),
    ),
    "L7": Mutant(
        "lease length of the grant ignored",
        "cloud_ends_by_itself",
        (
            Edit(
                "control.cloud.lease",
                "min(cloud.settings.lease_s, permission.lease_us / 1e6)",
                "cloud.settings.lease_s",
            ),
        ),
    ),
    "L8": Mutant(
        "lease 10 % too long",
        "slow_clock_in_the_cloud",
        (
            Edit(
                "fence.lease",
                "end_s = heard.echo_s + heard.length_s",
                "end_s = heard.echo_s + 1.1 * heard.length_s",
            ),
        ),
    ),
    "L10": Mutant(
        "says acting before its nodes are ready",
        "late_core_node_in_the_cloud",
        (Edit("control.cloud.lease", "acting=held and cloud.ready,", "acting=held,"),),
    ),
    "L11": Mutant(
        "ungranted permission renews",
        "first_command_after_a_cut",
        (Edit("fence.lease", "end_s)) if heard.granted else lease", "end_s))"),),
    ),
    "L12": Mutant(
        "echo of another incarnation grants",
        "stranger_in_the_echo",
        (
            Edit(
                "control.cloud.lease", "echo is not None and echo.incarnation == cloud.incarnation", "echo is not None"
            ),
        ),
    ),
    "L13": Mutant(
        "robot never forgotten",
        "robot_that_went",
        (
            Edit(
                "control.cloud.lease",
                "if cloud.robot and now_s - cloud.robot_s > cloud.settings.robot_live_s:",
                "if False:",
            ),
        ),
    ),
    "P1": Mutant(
        "permission stands for 4 beats",
        "vouching",
        (Edit("words.beats", "PERMISSION_BEATS = 2", "PERMISSION_BEATS = 4"),),
    ),
    "P2": Mutant(
        "any order of beats",
        "repeated_beats",
        (
            Edit(
                "pulse.pulse",
                "    if known is not None and beat.sent_us <= known.sent_us:\n        return pulse, False\n",
                "",
            ),
        ),
    ),
    "P3": Mutant(
        "foreign uid heard",
        "foreign_beats",
        (Edit("pulse.pulse", "if beat.uid != pulse.uid or beat.sender is pulse.side", "if beat.sender is pulse.side"),),
    ),
    "P4": Mutant(
        "own side's beats heard", "foreign_beats", (Edit("pulse.pulse", "beat.sender is pulse.side or ", ""),)
    ),
    "P5": Mutant(
        "order by sequence",
        "sequence_starts_anew",
        (Edit("pulse.pulse", "beat.sent_us <= known.sent_us", "beat.sequence <= known.sequence"),),
    ),
    "P6": Mutant(
        "echoes the last heard, not the partner",
        "second_cloud",
        (
            Edit(
                "pulse.pulse",
                "return matching or (pulse.heard[-1] if pulse.heard else None)",
                "return pulse.heard[-1] if pulse.heard else None",
            ),
        ),
    ),
    "P7": Mutant(
        "hold time not counted",
        "hold_time",
        (Edit("pulse.pulse", "hold_us = max(0, round((now_s - heard.arrived_s) * 1e6))", "hold_us = 0"),),
    ),
    "P8": Mutant(
        "both sides answer beats with beats",
        "beats_in_step",
        (Edit("pulse.pulse", "pulse.side is not Site.ROBOT or heard is None", "heard is None"),),
    ),
    "P9": Mutant(
        "no beat goes with one of the cloud",
        "beats_in_step",
        (Edit("pulse.pulse", "return arrived_s >= pulse.due_s - JOIN_PERIODS * pulse.beat_period_s", "return False"),),
    ),
    "P10": Mutant(
        "each beat of the cloud is answered, due or not",
        "beats_after_a_pause",
        (Edit("pulse.pulse", "return arrived_s >= pulse.due_s - JOIN_PERIODS * pulse.beat_period_s", "return True"),),
    ),
    "P11": Mutant(
        "beats are caught up in a burst",
        "beats_after_a_pause",
        (
            Edit(
                "pulse.pulse",
                "min(now_s, max(pulse.due_s, now_s - WAIT_PERIODS * period_s)) + period_s",
                "pulse.due_s + period_s",
            ),
        ),
    ),
    "C1": Mutant(
        "no BeforeRestart",
        "restarted_collector",
        (Edit("fence.gate", "if _before_restart(gate, header) and not lasts:", "if False:"),),
    ),
    "C2": Mutant(
        "negative age passes",
        "impossible_echo",
        (Edit("fence.freshness", "return 0 <= age_s <= most_s", "return age_s <= most_s"),),
    ),
    "C3": Mutant(
        "sequence starts anew at a changeover",
        "doubled_messages",
        (
            Edit(
                "fence.gate",
                "return tuple(-1 if held is None else held.sequence for held in gate.held)",
                "return (-1,) * len(gate.held)",
            ),
        ),
    ),
    "C4": Mutant(
        "fallen-back epoch of the cloud goes on",
        "fallback",
        (
            Edit(
                "fence.gate",
                "    if gate.fell_back and ours.site is Site.CLOUD:\n        return gate  # the robot has passed since: only a newer epoch may follow\n",
                "",
            ),
        ),
    ),
    "C6": Mutant(
        "effects after fallback",
        "fallback",
        (
            Edit(
                "fence.gate",
                "    if gate.fell_back or gate.charge is None or gate.said_s is None:\n        return Ruling",
                "    if gate.charge is None or gate.said_s is None:\n        return Ruling",
            ),
        ),
    ),
    "C7": Mutant(
        "earlier control heard",
        "earlier_control",
        (
            Edit("fence.gate", "    if word.started_us < gate.started_us:\n        return gate\n", ""),
            Edit("collector.gate", "    if gate.started_us < collector.started_us:\n        return collector\n", ""),
        ),
    ),
    "C9": Mutant(
        "one rated output that flows is enough",
        "inhibited_by_silence",
        (
            Edit(
                "collector.gate",
                "not robot_silent, not cloud_silent",
                "len(robot_silent) < len(rated), len(cloud_silent) < len(rated)",
            ),
        ),
    ),
    "C10": Mutant(
        "Hot robot passes while the cloud acts",
        "hot_robot_is_held_back",
        (Edit("fence.gate", "return gate, Ruling.CLOUD_IN_CHARGE", "return gate, Ruling.ROBOT_IN_CHARGE"),),
    ),
    "C11": Mutant(
        "held messages of any age",
        "held_too_long",
        (
            Edit(
                "fence.gate",
                "_fault(known) is None and fresh(now_s - held.born_s, gate.max_age_s)",
                "_fault(known) is None",
            ),
        ),
    ),
    "C12": Mutant(
        "repeats of the next side",
        "repeated_next",
        (
            Edit(
                "fence.gate",
                "        if held is not None and header.sequence <= held.sequence:\n            return gate, Ruling.REORDERED\n",
                "",
            ),
        ),
    ),
    "C13": Mutant(
        "passes the cloud before control spoke",
        "resumed_without_control",
        (
            Edit(
                "fence.gate",
                "    if gate.fell_back or gate.charge is None or gate.said_s is None:\n        return gate, Ruling",
                "    if gate.fell_back or gate.charge is None:\n        return gate, Ruling",
            ),
        ),
    ),
    "C14": Mutant(
        "fallback forgotten at restart",
        "fallback_outlives_the_collector",
        (Edit("fence.gate", "fell_back=fell_back, resumed_s=now_s)", "fell_back=False, resumed_s=now_s)"),),
    ),
    "C15": Mutant(
        "resumed collector waits for control for ever",
        "resumed_without_control",
        (
            Edit(
                "fence.gate",
                "spoken_s = gate.resumed_s if gate.said_s is None else gate.said_s",
                "spoken_s = gate.said_s",
            ),
        ),
    ),
    "C16": Mutant(
        "gate timeout doubled",
        "fallback",
        (Edit("fence.gate", "now_s - spoken_s <= gate.silence_s:", "now_s - spoken_s <= 2 * gate.silence_s:"),),
    ),
    "S1": Mutant(
        "clear without the lease",
        "effects_wait_for_the_lease",
        (
            Edit(
                "control.robot.changeovers",
                "return PERMISSION_BEATS * settings.beat_period_s + settings.lease_s + settings.drift_s",
                "return PERMISSION_BEATS * settings.beat_period_s",
            ),
        ),
    ),
    "S2": Mutant(
        "clear without the two beats and the margin for clocks",
        "effects_wait_for_the_lease",
        (
            Edit(
                "control.robot.changeovers",
                "return PERMISSION_BEATS * settings.beat_period_s + settings.lease_s + settings.drift_s",
                "return settings.lease_s",
            ),
        ),
    ),
    "S3": Mutant(
        "calling off keeps the epoch",
        "called_off",
        (
            Edit(
                "fence.grant",
                "return take_over(grant, now_s, stopped_s) if grant.candidate else grant",
                "return replace(grant, candidate=0, offered=False)",
            ),
        ),
    ),
    "S4": Mutant(
        "effects while the changeover is offered",
        "effects_while_offered",
        (
            Edit(
                "fence.grant",
                "return None if grant.offered or now_s < grant.clear_s else Site.ROBOT",
                "return None if now_s < grant.clear_s else Site.ROBOT",
            ),
        ),
    ),
    "S5": Mutant(
        "a stranger takes the place of a live cloud",
        "second_cloud",
        (Edit("control.robot.switcher", "if stranger and live:", "if False:"),),
    ),
    "S6": Mutant(
        "no Reopen at a loss",
        "first_command_after_a_cut",
        (Edit("control.robot.changeovers", "    commands.append(Reopen(fault.reason))\n", ""),),
    ),
    "S8": Mutant(
        "robot armed before its nodes are ready",
        "one_of_two_core_nodes",
        (
            Edit(
                "control.robot.switcher",
                "armed = robot.nodes_ready and readiness",
                "armed = readiness",
            ),
        ),
    ),
    "S9": Mutant(
        "no wait between attempts",
        "attempts_grow_apart",
        (Edit("control.robot.changeovers", "RETRY_FIRST_S = 1.0", "RETRY_FIRST_S = 0.0"),),
    ),
    "S10": Mutant(
        "by hand in spite of faults",
        "asked_while_cut",
        (
            Edit(
                "control.robot.switcher",
                '        if fault is not None:\n            return robot, False, f"Refused ({fault.reason}): {fault.message}"\n',
                "",
            ),
        ),
    ),
    "S11": Mutant(
        "min_dwell ignored",
        "dwell",
        (
            Edit(
                "control.robot.switcher",
                "dwelt = now_s - robot.charged_s >= robot.settings.min_dwell_s or verdict.reason.urgent",
                "dwelt = True",
            ),
        ),
    ),
    "S12": Mutant(
        "nodes not woken in TAKEOVER",
        "first_command_after_a_cut",
        (
            Edit(
                "control.robot.levels",
                "acting=robot.phase is not Phase.CLOUD,",
                "acting=robot.phase not in (Phase.CLOUD, Phase.TAKEOVER),",
            ),
        ),
    ),
    "S13": Mutant(
        "robot's silent outputs never stop the driver",
        "inhibited_by_silence",
        (
            Edit(
                "control.robot.levels",
                "    return gate is not None and (gate.robot_flows or (",
                "    return gate is None or (True or (",
            ),
        ),
    ),
    "S14": Mutant(
        "dead collector counts as acting",
        "hung_collector",
        (
            Edit(
                "control.robot.levels",
                "    if now_s - (started_s if reported_s is None else reported_s) > robot.settings.lease_s:\n        return now_s < robot.stalls.until_s and not starved(robot, now_s)  # its reports may still be unread\n",
                "",
            ),
        ),
    ),
    "S15": Mutant(
        "wish for the cloud survives a loss",
        "hold_down_after_a_loss",
        (
            Edit(
                "control.robot.changeovers",
                "manual = robot.manual if keeps else None",
                "manual = robot.manual",
            ),
        ),
    ),
    "S16": Mutant(
        "retry wait holds a robot that stands still",
        "helped_by_the_cloud",
        (
            Edit(
                "control.robot.switcher",
                "hurried_s = robot.retry_s if robot.both_silent else robot.since_s + changeovers.RETRY_FIRST_S",
                "hurried_s = robot.retry_s",
            ),
        ),
    ),
    "S17": Mutant(
        "robot unable is never helped",
        "helped_although_preferred",
        (
            Edit(
                "control.robot.switcher",
                "if fault is None and _in_need(robot, verdict, now_s)",
                "if False and _in_need(robot, verdict, now_s)",
            ),
        ),
    ),
    "S18": Mutant(
        "no deadline for the robot to get ready",
        "one_of_two_core_nodes",
        (
            Edit(
                "control.robot.switcher",
                "    if why is None and now_s >= preparation.deadline_s:\n        message",
                "    if False:\n        message",
            ),
        ),
    ),
    "S19": Mutant(
        "begins on old news after a stall",
        "stall_on_old_news",
        (Edit("control.robot.switcher", "    if now_s < robot.stalls.until_s:  # what", "    if False:  # what"),),
    ),
    "S20": Mutant(
        "another cloud's charge taken as ours",
        "restarted_control",
        (
            Edit(
                "fence.grant",
                "charge.token.robot != grant.robot or not grant.epoch < charge.token.epoch <= grant.last_epoch:",
                "not grant.epoch < charge.token.epoch:",
            ),
        ),
    ),
    "H5": Mutant(
        "stale inputs of the cloud ignored",
        "stale_input",
        (Edit("control.robot.limits", "    Limit(Reason.INPUT_STALE, _R, False, _input_stale),\n", ""),),
    ),
    "H6": Mutant(
        "silent outputs of the cloud ignored",
        "silent_cloud_output",
        (Edit("control.robot.limits", "    Limit(Reason.OUTPUT_SILENT, _R, True, _output_silent),\n", ""),),
    ),
    "H7": Mutant(
        "data session never judged",
        "silent_data_session",
        (
            Edit(
                "control.robot.limits",
                "    Limit(Reason.DATA_PROCESS_SILENT, _S, False, _data_process_silent),\n    Limit(Reason.DATA_DISCONNECTED, _R, False, _data_disconnected),\n    Limit(Reason.DATA_SILENT, _S, False, _data_silent),\n    Limit(Reason.DATA_MISMATCH, _R, False, _data_mismatch),\n    Limit(Reason.DATA_UNHEARD, _R, False, _data_unheard),\n",
                "",
            ),
        ),
    ),
    "H9": Mutant(
        "collector never judged",
        "hung_collector",
        (
            Edit(
                "control.robot.limits",
                "    Limit(Reason.COLLECTOR_SILENT, _S, False, _collector_silent),\n    Limit(Reason.COLLECTOR_FELL_BACK, _R, False, _collector_fell_back),\n",
                "",
            ),
        ),
    ),
    "H11": Mutant(
        "late echoes ignored",
        "deaf_cloud",
        (Edit("control.robot.limits", "    Limit(Reason.ECHO_STALE, _S, False, _echo_stale),\n", ""),),
    ),
    "H12": Mutant(
        "good beats never judged",
        "bare_beats",
        (Edit("control.robot.limits", "    Limit(Reason.CLOUD_NOT_ACTING, _S, True, _no_good_beat),\n", ""),),
    ),
    "H14": Mutant(
        "stall grace without end",
        "long_stall_of_control",
        (
            Edit(
                "control.robot.limits",
                "    if acting and view.silent(view.situation.good_s, view.frame.settings.lease_s):",
                "    if False:",
            ),
        ),
    ),
    "H15": Mutant(
        "pulse and data at different clouds",
        "probes_of_another_cloud",
        (Edit("control.robot.limits", "    Limit(Reason.DATA_MISMATCH, _R, False, _data_mismatch),\n", ""),),
    ),
    "H16": Mutant(
        "silent cloud control ignored",
        "silent_cloud_control",
        (
            Edit(
                "control.robot.limits",
                "broken = view.report is None or age_s is None or age_s > view.frame.settings.loss_timeout_s",
                "broken = view.report is None",
            ),
        ),
    ),
    "W1": Mutant(
        "pins ignored",
        "pinned",
        (
            Edit(
                "control.robot.requests",
                "    if robot.pin is not None and robot.pin.holds(now_s):\n        return robot.pin.site\n",
                "",
            ),
        ),
    ),
    "W2": Mutant(
        "clock offset ignored",
        "apart_clocks",
        (Edit("control.robot.requests", "fault = clock_fault(robot.link, robot.settings)", "fault = None"),),
    ),
    "W3": Mutant(
        "by hand ignored",
        "there_and_back",
        (Edit("control.robot.requests", "if robot.manual is not None and robot.manual.holds(now_s):", "if False:"),),
    ),
    "W4": Mutant(
        "replicas with other parameters hinder nobody",
        "other_parameters",
        (
            Edit(
                "control.robot.requests",
                "if verdict.site is Site.CLOUD and lacking is not None and IN_CHARGE[robot.phase] is Site.ROBOT:",
                "if False:",
            ),
        ),
    ),
    "W5": Mutant(
        "replicas with other parameters end a stay",
        "other_parameters",
        (
            Edit(
                "control.robot.requests",
                " and lacking is not None and IN_CHARGE[robot.phase] is Site.ROBOT:",
                " and lacking is not None:",
            ),
        ),
    ),
    "W6": Mutant(
        "a person gets replicas with other parameters at once",
        "other_parameters",
        (
            Edit(
                "control.robot.readiness", "lacks = lacking(robot) if candidate is Site.CLOUD else None", "lacks = None"
            ),
        ),
    ),
    "K1": Mutant(
        "echo from the future gives a round trip",
        "echo_from_the_future",
        (Edit("link.links", "if round_trip_s < 0 or (", "if ("),),
    ),
    "K2": Mutant(
        "overdue echoes do not count as latency",
        "overdue_echoes",
        (
            Edit(
                "link.links",
                "return max(link.round_trip_s, now_s - link.echo_sent_s - 2 * beat_period_s)",
                "return link.round_trip_s",
            ),
        ),
    ),
    "K3": Mutant(
        "a steady clock that stood still is taken for system clocks that differ",
        "paused_virtual_machine",
        (Edit("link.links", "if known and not stood and half_s", "if known and half_s"),),
    ),
    "K4": Mutant(
        "a late copy of a beat is news",
        "late_copies",
        (Edit("link.links", "or beat.sent_us > link.sent_us", "or beat.sent_us != link.sent_us"),),
    ),
    "K5": Mutant(
        "a doubled beat counts twice",
        "late_copies",
        (Edit("link.links", "or beat.sent_us > link.sent_us", "or beat.sent_us >= link.sent_us"),),
    ),
    "K6": Mutant(
        "what a copy of a beat reports is taken",
        "late_copies",
        (Edit("control.robot.switcher", "if not links.is_news(link, beat):", "if False:"),),
    ),
    "N1": Mutant(
        "the cloud's beats name the robot",
        "the_robots_name_stays_with_the_robot",
        (Edit("pulse.pulse", "        beat = veil(beat)\n", "        pass\n"),),
    ),
    "N2": Mutant(
        "the cloud's envelopes name the robot",
        "the_robots_name_stays_with_the_robot",
        (Edit("data.cloud", " if self.egress.veils else header)", " if False else header)"),),
    ),
    "N3": Mutant(
        "an older partner is spoken to in our version",
        "older_robot",
        (Edit("pulse.pulse", "version=VERSION if heard is None else heard.version", "version=VERSION"),),
    ),
    "N5": Mutant(
        "an input is published whatever type the robot's message has",
        "types_that_differ",
        (
            Edit(
                "data.cloud",
                'return "" if not ours or same_type(ours, theirs) else Reason.TYPES_DIFFER.value',
                'return ""',
            ),
        ),
    ),
    "N6": Mutant(
        "inputs of different types are no limit",
        "types_that_differ",
        (Edit("data.robot", "        self._compare_inputs(received)\n", ""),),
    ),
    "N4": Mutant(
        "lists in another order are compared by place",
        "lists_in_another_order",
        (
            Edit(
                "control.robot.limits",
                "if not theirs or not ours or theirs == ours:",
                "if True:",
            ),
        ),
    ),
    "T1": Mutant(
        "no drift margin",
        "slow_clock_in_the_cloud",
        (Edit("words.settings", "return self.lease_s * DRIFT_SHARE + 0.001", "return 0.0"),),
    ),
    "T2": Mutant(
        "settings change at once",
        "shorter_lease_at_run_time",
        (
            Edit(
                "control.robot.settling",
                "    held = replace(asked, lease_s=max(present.lease_s, asked.lease_s))\n",
                "    return asked\n    held = replace(asked, lease_s=max(present.lease_s, asked.lease_s))\n",
            ),
        ),
    ),
    "E1": Mutant(
        "envelope decodes the epoch one too high",
        "there_and_back",
        (
            Edit(
                "fence.envelope",
                'token = Token("" if robot == ABSENT else robot.hex(), epoch,',
                'token = Token("" if robot == ABSENT else robot.hex(), epoch + 1,',
            ),
        ),
    ),
    "Y1": Mutant(
        "hold-down ignored",
        "hold_down_after_a_loss",
        (Edit("link.policies", "left_s = min(policy.hold_until_s - now_s, PROVEN_S - policy.good_s)", "left_s = 0.0"),),
    ),
    "G1": Mutant(
        "nodes do not wait for each other",
        "order_of_bring_up",
        (
            Edit(
                "control.nodes.guardians",
                "waits_core = waits_core or (node.spec.core and managed_nodes.rises(node))",
                "waits = False",
            ),
        ),
    ),
    "G2": Mutant(
        "one CORE node is enough",
        "one_of_two_core_nodes",
        (
            Edit(
                "control.nodes.guardians",
                "return all(managed_nodes.stays_active(n) for n in core)",
                "return any(managed_nodes.stays_active(n) for n in core)",
            ),
        ),
    ),
    "G3": Mutant(
        "ready while being put to sleep",
        "change_of_mind",
        (
            Edit(
                "control.nodes.managed_nodes",
                "return node.state is State.ACTIVE and node.asked is not Transition.DEACTIVATE",
                "return node.state is State.ACTIVE",
            ),
        ),
    ),
    "G5": Mutant(
        "gives up after 1 s",
        "restarted_node",
        (Edit("control.nodes.managed_nodes", "GIVE_UP_S = 60.0", "GIVE_UP_S = 1.0"),),
    ),
    "G6": Mutant(
        "inhibit is said once",
        "forgetful_driver",
        (
            Edit(
                "control.nodes.guardians",
                "repeat = (inhibit or guardian.inhibited is not inhibit) and now_s >= guardian.inhibit_due_s",
                "repeat = False",
            ),
        ),
    ),
    "G7": Mutant(
        "dead CORE nodes of the robot do not stop the driver",
        "inhibited_by_death",
        (
            Edit(
                "control.nodes.guardians",
                '            return f"CORE node {node.spec.name} is {node.state.value}"\n',
                "            continue\n",
            ),
        ),
    ),
    "G8": Mutant(
        "nodes are never read again",
        "restarted_node",
        (Edit("control.nodes.managed_nodes", "READ_PERIOD_S = 1.0", "READ_PERIOD_S = 1e9"),),
    ),
    "G9": Mutant(
        "silence never stops the driver",
        "inhibited_by_silence",
        (Edit("control.nodes.guardians", "return guardian.in_charge and not guardian.outputs_flow", "return False"),),
    ),
    "G10": Mutant(
        "grace ten times as long",
        "inhibited_by_death",
        (
            Edit(
                "control.nodes.guardians",
                "now_s - since_s >= guardian.grace_s or",
                "now_s - since_s >= 10 * guardian.grace_s or",
            ),
        ),
    ),
    "G11": Mutant(
        "duplicated nodes never put to sleep",
        "there_and_back",
        (
            Edit(
                "control.nodes.guardians",
                "active = not node.spec.duplicated or guardian.acting or node.spec.hot",
                "active = True",
            ),
        ),
    ),
    "C17": Mutant(
        "a starved collector never judges silence",
        "starved_collector",
        (
            Edit(
                "collector.gate",
                "collector.judged_from_s if in_a_row else now_s + PAUSE_GRACE_S",
                "now_s + PAUSE_GRACE_S",
            ),
        ),
    ),
    "G12": Mutant(
        "a dead node holds up every CORE node behind it",
        "dead_node_before_the_core",
        (
            Edit(
                "control.nodes.guardians",
                "waits_core = waits_core or (node.spec.core and managed_nodes.rises(node))",
                "waits_core = waits_core or node.state is not State.ACTIVE",
            ),
        ),
    ),
    "C18": Mutant(
        "outputs that need not speak never change over",
        "nothing_to_hear",
        (
            Edit(
                "collector.gate",
                "    if following is None or any(_awaited(collector, o, following.site) for o in collector.outputs):",
                "    if True:",
            ),
        ),
    ),
    "S21": Mutant(
        "a stall of control is taken for a silent collector",
        "stall_inhibits_nobody",
        (
            Edit(
                "control.robot.levels",
                "return now_s < robot.stalls.until_s and not starved(robot, now_s)  # its reports",
                "return False  # its reports",
            ),
        ),
    ),
    "S22": Mutant(
        "grace after a pause lifts an inhibit",
        "released_by_messages",
        (
            Edit(
                "control.robot.levels", "    return passes and due <= set(gate.robot_flowing)\n", "    return passes\n"
            ),
        ),
    ),
    "S23": Mutant(
        "reports from before a hang lift an inhibit",
        "no_release_by_old_reports",
        (
            Edit(
                "control.robot.levels",
                "    if gate is None or reported_s is None or now_s - reported_s > settings.lease_s:\n        return False\n    passes",
                "    if gate is None:\n        return False\n    passes",
            ),
        ),
    ),
    "S24": Mutant(
        "what the collector holds back lifts an inhibit",
        "held_back_is_not_heard",
        (
            Edit(
                "control.robot.levels",
                "passes = gate.charge is None or gate.charge.site is Site.ROBOT or gate.fell_back",
                "passes = True",
            ),
        ),
    ),
    "S25": Mutant(
        "slow outputs hold the driver after nodes that woke late",
        "slow_outputs_hold_nobody",
        (
            Edit(
                "control.robot.levels",
                "    due -= {one.index for one in _slow(robot) if not one.unseen(since_s, now_s)}\n",
                "",
            ),
        ),
    ),
    "S27": Mutant(
        "a robot that cannot act waits for a slow output of the cloud",
        "need_waits_for_no_slow_output",
        (
            Edit(
                "collector.gate",
                "held = not (collector.prompt and slow_outputs.is_slow(output.spec, collector.activation_s))",
                "held = True",
            ),
        ),
    ),
    "S28": Mutant(
        "a robot that falls while the cloud gets ready is no need",
        "need_waits_for_no_slow_output",
        (
            Edit(
                "control.robot.switcher",
                "    if _unable(robot, now_s):\n        preparation",
                "    if False:\n        preparation",
            ),
        ),
    ),
    "S29": Mutant(
        "a slow output of the cloud has no deadline from the changeover on",
        "need_waits_for_no_slow_output",
        (Edit("collector.gate", "cloud_s = None if acts else collector.acts_s", "cloud_s = None"),),
    ),
    "S30": Mutant(
        "the return of a node gives its slow output no deadline",
        "returned_nodes_are_released_before_their_slow_output_speaks",
        (Edit("control.robot.levels", "if one.excused(now_s)", "if False"),),
    ),
    "S31": Mutant(
        "each return of a node gives its slow output a deadline",
        "returning_again_earns_no_second_deadline",
        (
            Edit(
                "words.slow_outputs",
                "returns = one.asleep and not asleep and one.seen_s > one.woken_s",
                "returns = one.asleep and not asleep",
            ),
        ),
    ),
    "S32": Mutant(
        "a slow output holds a driver that was stopped for the collector",
        "collector_that_returns_waits_for_no_slow_output",
        (Edit("words.slow_outputs", "max(since_s, self.seen_s, self.woken_s)", "max(since_s, self.woken_s)"),),
    ),
    "S33": Mutant(
        "a veto waits for a slow output of the robot",
        "veto_waits_for_no_slow_output",
        (
            Edit(
                "control.robot.switcher",
                "prompt = preparation.prompt or verdict.reason.kind is Kind.VETO",
                "prompt = preparation.prompt",
            ),
        ),
    ),
    "S26": Mutant(
        "silence is judged before all that waits was read",
        "beat_behind_other_words",
        (
            Edit(
                "control.robot.placement",
                "        return max(self.stalls.read_s, self.link.heard_s or 0.0)\n",
                "        return now_s\n",
            ),
        ),
    ),
    "C19": Mutant(
        "a restarted collector counts as having heard the robot",
        "released_by_messages",
        (
            Edit(
                "collector.gate",
                "    return replace(collector, fence=resumed, stay=stay)",
                "    outputs = tuple(replace(o, robot_s=now_s) for o in collector.outputs)\n"
                "    collector = replace(collector, outputs=outputs)\n"
                "    return replace(collector, fence=resumed, stay=stay)",
            ),
        ),
    ),
    "G13": Mutant(
        "the first word of a restarted control lifts an inhibit",
        "restarted_control_releases_by_messages",
        (
            Edit(
                "control.nodes.guardians",
                "if guardian.inhibit_said is False or",
                "if guardian.inhibit_said is not True or",
            ),
        ),
    ),
    "G14": Mutant(
        "a request that overtook the newest one is the driver's last word",
        "overtaken_words",
        (Edit("control.nodes.guardians", "    if inhibited is guardian.inhibit_said:\n", "    if True:\n"),),
    ),
    "X35": Mutant(
        "an input that waited for the robot's data process crosses as new",
        "inputs_that_waited",
        (
            Edit(
                "data.robot",
                "waited_s = 0.0 if name in self.latched else self.waited_s(self.waits[name], published_s)",
                "waited_s = 0.0",
            ),
        ),
    ),
    "X30": Mutant(
        "a busy CORE node of the cloud counts as dead although its outputs flow",
        "busy_node_in_the_cloud",
        (Edit("control.cloud.process", "        self.note_flowing(message.flowing)\n", ""),),
    ),
    "X31": Mutant(
        "replicas of the cloud that fell silent count as alive",
        "busy_node_in_the_cloud",
        (Edit("data.cloud", " and now_s - self.spoke_s[i] <= o.deadline_s\n", "\n"),),
    ),
    "X32": Mutant(
        "a latched input that changes ends the stay",
        "map_that_changes",
        (
            Edit(
                "control.cloud.process",
                "return self.is_ready() and (self.complete or acting)",
                "return self.is_ready() and self.complete",
            ),
        ),
    ),
    "X33": Mutant(
        "older latched values are kept until one is sent again",
        "map_that_changes",
        (
            Edit(
                "data.cloud",
                "                for name in self.latched:\n                    self._drop_older(name)\n",
                "                pass\n",
            ),
        ),
    ),
    "X34": Mutant(
        "what is held is said once a second, not until it has arrived",
        "request_over_a_lossy_link",
        (
            Edit(
                "data.process",
                "if made.digest != self.acknowledged or now_s >= self.whole_due_s:",
                "if now_s >= self.whole_due_s:",
            ),
        ),
    ),
    "H17": Mutant(
        "what was reported waits for the end of a stall",
        "reported_in_a_stall",
        (
            Edit(
                "control.robot.limits",
                "and not (stalled and limit.basis is Basis.SILENCE)",
                "and not stalled",
            ),
        ),
    ),
    "H14+H18": Mutant(
        "a starved control waits for ever",
        "starved_control_and_a_cut",
        (
            Edit("control.robot.limits", "    if view.frame.starved:", "    if False:"),
            Edit(
                "control.robot.limits",
                "    if acting and view.silent(view.situation.good_s, view.frame.settings.lease_s):",
                "    if False:",
            ),
        ),
    ),
    "X1": Mutant(
        "the egress does not look at the lease",
        "cloud_ends_by_itself",
        (Edit("fence.lease", "return token if now_s < end_s else None", "return token"),),
    ),
    "G20": Mutant(
        "a node without a lifecycle is taken for alive",
        "plain_node_that_is_not_there",
        (Edit("control.nodes.managed_nodes", "State.ACTIVE if seen else State.UNKNOWN", "State.ACTIVE"),),
    ),
    "G21": Mutant(
        "a node without a lifecycle is asked for transitions",
        "plain_nodes_on_both_sides",
        (
            Edit(
                "control.nodes.guardians",
                "        if node.spec.lifecycle and wanted(guardian, node) is State.INACTIVE:",
                "        if wanted(guardian, node) is State.INACTIVE:",
            ),
            Edit("control.nodes.guardians", "guardian.acting or node.spec.hot\n", "guardian.acting\n"),
        ),
    ),
    "O1": Mutant(
        "what was filled in is collected",
        "shared_topic_through_changeovers",
        (Edit("topics.shared", "if self.filled.own(payload, now_s):", "if False:"),),
    ),
    "O2": Mutant(
        "what has passed is taken for what others say",
        "shared_topic_through_changeovers",
        (Edit("topics.shared", "if self.said.own(payload, now_s):", "if False:"),),
    ),
    "O3": Mutant(
        "the robot's standby does not hear the holder",
        "shared_topic_through_changeovers",
        (Edit("collector.process", "                self._give_to_standby(other, passed)", "                pass"),),
    ),
    "O4": Mutant(
        "others are not heard in the cloud",
        "shared_topic_through_changeovers",
        (
            Edit(
                "collector.process",
                '        self.ports.fill(index, said)\n        self.ports.carry("data", OTHERS, index, self._header(), said)\n',
                "        self.ports.fill(index, said)\n",
            ),
        ),
    ),
    "O5": Mutant(
        "the cloud's standby does not hear the holder",
        "shared_topic_through_changeovers",
        (
            Edit(
                "data.cloud",
                "                self._give_to_standby(self.index[name], payload)",
                "                pass",
            ),
        ),
    ),
    "O6": Mutant(
        "latched words of others are not sent again",
        "latched_words_of_others",
        (
            Edit(
                "data.robot",
                "                    if name in self.shared:\n                        self.ports.cross(name, self._header(name), value)\n",
                "                    if name in self.shared:\n                        continue\n",
            ),
        ),
    ),
    "O7": Mutant(
        "latched words of others are said each time they come",
        "latched_words_of_others",
        (Edit("data.cloud", "            if known:\n                return\n", ""),),
    ),
    "O8": Mutant(
        "a data process that was started anew on the robot does not know what others said",
        "latched_words_of_others",
        (Edit("collector.process", "            self._repeat_others(now_s)\n", ""),),
    ),
    "R1": Mutant(
        "results of any age pass",
        "results_of_a_slow_link",
        (Edit("fence.gate", "if not fresh(header.age_s(now_s), max_age_s):", "if False:"),),
    ),
    "R2": Mutant(
        "results pass under any token",
        "results_of_two_robots_lives",
        (Edit("fence.gate", "if gate.presence is None or header.token != gate.presence:", "if False:"),),
    ),
    "R3": Mutant(
        "results pass twice and in any order",
        "results_that_come_twice",
        (Edit("fence.gate", "header.sequence <= newest[1]:", "False:"),),
    ),
    "R4": Mutant(
        "results leave under the charge",
        "results_whoever_is_in_charge",
        (Edit("fence.lease", "(held.presence, held.presence_end_s) if of_cloud else ", ""),),
    ),
    "R5": Mutant(
        "presence lasts from the arrival of a grant",
        "results_after_old_grants",
        (
            Edit(
                "fence.lease",
                "presence_end_s=max(lease.presence_end_s, end_s)",
                "presence_end_s=max(lease.presence_end_s, now_s + heard.length_s)",
            ),
        ),
    ),
    "R6": Mutant(
        "a new egress counts results from one again",
        "results_of_a_restarted_agent",
        (Edit("data.cloud", "self.first_result if self.plan.outputs[index].of_cloud else 0", "0"),),
    ),
    "R7": Mutant(
        "pulse vouches for presence",
        "results_of_a_robot_that_stopped_vouching",
        (Edit("pulse.pulse", "and (body.granted or body.presence)", "and body.granted"),),
    ),
    "R8": Mutant(
        "results older than this collector pass",
        "results_that_come_twice",
        (Edit("fence.gate", "if _before_restart(gate, header):", "if False:"),),
    ),
    "R9": Mutant(
        "a changeover waits for results",
        "results_alone",
        (Edit("words.settings", "return self.deadline_s > 0 and not self.of_cloud", "return self.deadline_s > 0"),),
    ),
    "X2": Mutant(
        "what waited in a stopped egress leaves as new",
        "queues_after_a_pause",
        (Edit("data.cloud", "if self.pauses.waited(self.ports.now_s()) and output.rated:", "if False:"),),
    ),
    "X3": Mutant(
        "what waited for the egress leaves as new",
        "messages_that_waited_for_the_egress",
        (Edit("data.cloud", "heard.echo_us(waited_s) if heard", "heard.sent_us if heard"),),
    ),
    "X4": Mutant(
        "inputs of another robot reach the replicas",
        "old_inputs",
        (
            Edit(
                "data.cloud",
                "if opened.token.robot != self.egress.robot or not opened.token.robot:",
                "if False:",
            ),
            Edit("data.cloud", "if self.probe and self.probe.incarnation == robot else", "if self.probe else"),
        ),
    ),
    "X5": Mutant(
        "inputs of any age reach the replicas",
        "old_inputs",
        (Edit("data.cloud", "if self.max_age_ms[name] and age_s * 1e3 > self.max_age_ms[name]:", "if False:"),),
    ),
    "X6": Mutant(
        "the cloud is ready without the latched inputs",
        "missing_map",
        (
            Edit(
                "control.cloud.process",
                "return self.is_ready() and (self.complete or acting)",
                "return self.is_ready()",
            ),
        ),
    ),
    "X7": Mutant(
        "latched inputs are sent once",
        "latched_input",
        (Edit("data.robot", "if now_s - last_s >= RESEND_PERIOD_S:", "if False:"),),
    ),
    "X8": Mutant(
        "what waited in a stopped collector passes as new",
        "queues_after_a_pause",
        (Edit("collector.process", "if self.pauses.waited(now_s) and spec.deadline_s:", "if False:"),),
    ),
    "M1": Mutant(
        "consumers in the cloud hear an older stay again",
        "one_side_in_the_cloud",
        (
            Edit(
                "topics.mirror",
                "    if same and (token.epoch < mirror.epoch or (token.epoch == mirror.epoch and mirror.site is not site)):\n        return mirror, False\n",
                "",
            ),
        ),
    ),
    "M2": Mutant(
        "consumers in the cloud hear its replica while it only gets ready",
        "one_side_in_the_cloud",
        (
            Edit(
                "topics.mirror",
                "return _pass(mirror, token, Site.CLOUD) if in_charge else (mirror, False)",
                "return mirror, True",
            ),
        ),
    ),
    "V1": Mutant(
        "a second publisher is no veto",
        "second_publisher",
        (
            Edit(
                "control.robot.process",
                "if reason in VETOES and (",
                "if reason in VETOES and reason != Reason.SECOND_PUBLISHER and (",
            ),
        ),
    ),
    "V2": Mutant(
        "`strict` does not stop the wheels",
        "second_publisher",
        (Edit("control.robot.process", "stops=self.strict and VETOES[reason].forbids", "stops=False"),),
    ),
    "V3": Mutant(
        "a veto that the robot cannot obey never becomes a limit",
        "second_publisher_unobeyed",
        (
            Edit(
                "control.robot.requests",
                "overdue = acting and since_s is not None",
                "overdue = False and since_s is not None",
            ),
        ),
    ),
    "X9": Mutant(
        "what was held for a changeover is lost",
        "nothing_is_lost",
        (
            Edit(
                "collector.process",
                "for other in passage.also if other in kept]",
                "for other in passage.also if False]",
            ),
        ),
    ),
    "X11": Mutant(
        "the collector's memory is not written",
        "unsaved_memory",
        (Edit("collector.process", "            self.ports.save(state)\n", "            pass\n"),),
    ),
    "X12": Mutant(
        "consumers in the cloud do not hear the robot",
        "consumers_in_the_cloud",
        (Edit("collector.process", "        if not mirrored:", "        if True:"),),
    ),
    "X13": Mutant(
        "the collector takes no changed limits",
        "shorter_limits",
        (Edit("collector.process", "            self.state = gate.limit(", "            gate.limit("),),
    ),
    "X15": Mutant(
        "levels are sent once",
        "restarted_data_on_a_robot_that_stays",
        (
            Edit(
                "control.robot.process",
                "elif now_s - sent_s >= self.settings.lease_s / LEVELS_PER_LEASE:",
                "elif False:",
            ),
        ),
    ),
    "X16": Mutant(
        "readiness is reported at changes only",
        "nothing_to_wait_for",
        (
            Edit(
                "control.process",
                "self.told_ready: bool | None = None",
                "self.told_ready: bool | None = self.is_ready()",
            ),
        ),
    ),
    "X17": Mutant(
        "a loss is noticed at the next turn",
        "loss_to_the_millisecond",
        (
            Edit(
                "control.robot.process",
                "return good_s + self.settings.loss_timeout_s + DEADLINE_MARGIN_S",
                'return float("inf")',
            ),
        ),
    ),
    "X19": Mutant(
        "a request that is none ends the robot's control",
        "asked_in_the_cloud",
        (Edit("control.robot.process", "if site in (Site.ROBOT.value, Site.CLOUD.value):", "if True:"),),
    ),
    "X20": Mutant(
        "requests from the cloud are not answered",
        "asked_in_the_cloud",
        (
            Edit(
                "control.robot.process",
                'return f"{self.asked_in_cloud}|{self.cloud_answer}" if self.asked_in_cloud else ""',
                'return ""',
            ),
        ),
    ),
    "X21": Mutant(
        "the announced end of the cloud's pods is not heard",
        "pods_that_go",
        (Edit("control.robot.process", "        self.step(placement.CloudLeaving(cloud, until_s))\n", ""),),
    ),
    "X22": Mutant(
        "the cloud's levels are sent at changes only",
        "short_stall_of_control",
        (
            Edit(
                "control.cloud.process",
                "if level != self.told or now_s - self.told_s >= self.settings.beat_period_s:",
                "if level != self.told:",
            ),
        ),
    ),
    "X23": Mutant(
        "a request that nobody hears is never answered",
        "unheard_request",
        (
            Edit(
                "control.cloud.process", "if self.request and self.ports.now_s() >= self.request_until_s:", "if False:"
            ),
        ),
    ),
    "X24": Mutant(
        "only the pulse session is opened anew at a loss",
        "first_command_after_a_cut",
        (Edit("control.robot.process", 'for process in ("pulse", "data"):', 'for process in ("pulse",):'),),
    ),
    "X26": Mutant(
        "inputs are not thinned out",
        "many_inputs",
        (
            Edit(
                "data.robot",
                "if now_s - self.sent_s.get(name, 0.0) < EARLY_SHARE * self.least_s[name]:",
                "if False:",
            ),
        ),
    ),
    "X27": Mutant(
        "what waited in a stopped data process is sent as new",
        "inputs_after_a_pause",
        (Edit("data.robot", "if self.pauses.waited(now_s) and name in self.aged:", "if False:"),),
    ),
    "D1": Mutant(
        "a refused message thins nothing",
        "narrow_link",
        (Edit("data.robot", "self.paces.refused(name, self.ports.now_s())", "pass"),),
    ),
    "D2": Mutant(
        "all priorities are thinned alike",
        "narrow_link",
        (Edit("topics.pacing", "ORDER[: ORDER.index(own.priority) + 1]", "(own.priority,)"),),
    ),
    "D3": Mutant(
        "an input is thinned below its least rate",
        "narrow_link",
        (
            Edit("topics.pacing", "or self.least_s >= self.slowest_s", ""),
            Edit("topics.pacing", "min(self.slowest_s, SLOWER * max(self.least_s, self.usual_s))", "60.0"),
        ),
    ),
    "D4": Mutant(
        "what was refused is never sent",
        "newest_first",
        (Edit("data.robot", "if not sent and name in self.latest:", "if False:"),),
    ),
    "D5": Mutant(
        "what was sent later is sent again",
        "newest_first",
        (Edit("data.robot", "waiting = self.waiting.pop(name, None)", "waiting = self.waiting.get(name)"),),
    ),
    "D6": Mutant(
        "a message that waits for room thins the input",
        "late_but_in_time",
        (Edit("data.robot", "name not in self.latest or replaced is not None", "True"),),
    ),
    "X29": Mutant(
        "missing replicas are not reported",
        "replicas_missing",
        (Edit("control.robot.process", "if now_s - self.complete_s < REPLICA_GRACE_S:", "if True:"),),
    ),
    "H12+H13": Mutant(
        "good beats never judged; loss timeout doubled",
        "first_command_after_a_cut",
        (
            Edit("control.robot.limits", "    Limit(Reason.CLOUD_NOT_ACTING, _S, True, _no_good_beat),\n", ""),
            Edit(
                "control.robot.limits",
                "if heard_s is None or not view.silent(heard_s, view.frame.settings.loss_timeout_s):",
                "if heard_s is None or not view.silent(heard_s, 2 * view.frame.settings.loss_timeout_s):",
            ),
        ),
    ),
    "C8+C17": Mutant(
        "silence never judged; a starved collector never judges silence",
        "inhibited_by_silence",
        (
            Edit("collector.gate", "PAUSE_S = 0.120", "PAUSE_S = 0.0"),
            Edit(
                "collector.gate",
                "collector.judged_from_s if in_a_row else now_s + PAUSE_GRACE_S",
                "now_s + PAUSE_GRACE_S",
            ),
        ),
    ),
    "L4+L9+P2": Mutant(
        "older epoch's grant renews; robot beats in any order; any order of beats",
        "old_grants",
        (
            Edit("fence.lease", " or token.epoch < lease.epoch:\n", ":\n"),
            Edit("control.cloud.lease", "    if beat.sent_us <= cloud.robot_sent_us:\n        return cloud\n", ""),
            Edit(
                "pulse.pulse",
                "    if known is not None and beat.sent_us <= known.sent_us:\n        return pulse, False\n",
                "",
            ),
        ),
    ),
    "H1+H11": Mutant(
        "good beat without echo limit; late echoes ignored",
        "deaf_cloud",
        (
            Edit(
                "control.robot.health",
                "        and arrived_s - beat.echo.sent_us / 1e6 <= frame.settings.echo_limit_s\n",
                "",
            ),
            Edit("control.robot.limits", "    Limit(Reason.ECHO_STALE, _S, False, _echo_stale),\n", ""),
        ),
    ),
    "H2+H21": Mutant(
        "good beat without acting; a cloud that does not act is no fault",
        "unpermitted",
        (
            Edit("control.robot.health", "        and report.acting\n", ""),
            Edit(
                "control.robot.limits",
                "view.report.acting and view.report.epoch == view.frame.epoch",
                "view.report.epoch == view.frame.epoch",
            ),
        ),
    ),
    "H3+H22": Mutant(
        "good beat of any epoch; a cloud that acts under another epoch is no fault",
        "served_elsewhere",
        (
            Edit("control.robot.health", "        and report.epoch == frame.epoch\n", ""),
            Edit(
                "control.robot.limits",
                "view.report.acting and view.report.epoch == view.frame.epoch",
                "view.report.acting",
            ),
        ),
    ),
    "H4+H10": Mutant(
        "good beat that serves another robot; identity never judged",
        "served_elsewhere",
        (
            Edit("control.robot.health", "        and report.serves == frame.incarnation\n", ""),
            Edit(
                "control.robot.limits",
                "    Limit(Reason.DUPLICATE_IDENTITY, _R, False, _duplicate_identity),\n    Limit(Reason.NOT_SERVED, _R, False, _not_served),\n",
                "",
            ),
        ),
    ),
    "H2+H8+H21": Mutant(
        "good beat without acting; dead CORE nodes of the cloud ignored; a cloud that does not act is no fault",
        "dead_cloud_node",
        (
            Edit("control.robot.health", "        and report.acting\n", ""),
            Edit("control.robot.limits", "    Limit(Reason.CLOUD_NODES_DOWN, _R, True, _cloud_nodes_down),\n", ""),
            Edit(
                "control.robot.limits",
                "view.report.acting and view.report.epoch == view.frame.epoch",
                "view.report.epoch == view.frame.epoch",
            ),
        ),
    ),
    **HANDOVER,
    **HOT,
    **WHILE,
    **GARBAGE,
}
"""Each is found by its story."""

EQUIVALENT: dict[str, Equivalent] = {
    "H18": Equivalent(
        "a starved control waits for ever",
        "a cloud in charge is left once no good beat came for a lease (H14), whatever the stalls. Removed together: H14+H18",
        (Edit("control.robot.limits", "    if view.frame.starved:", "    if False:"),),
    ),
    "L4": Equivalent(
        "older epoch's grant renews",
        "beats of one sender are taken in the order of their sending twice (P2 in the pulse, L9 in the lease): an older epoch never comes later. Removed together with both: L4+L9+P2",
        (Edit("fence.lease", " or token.epoch < lease.epoch:\n", ":\n"),),
    ),
    "L9": Equivalent(
        "robot beats in any order",
        "the pulse takes no older beat (P2). Removed together: L4+L9+P2",
        (Edit("control.cloud.lease", "    if beat.sent_us <= cloud.robot_sent_us:\n        return cloud\n", ""),),
    ),
    "C5": Equivalent(
        "fallback keeps what is next",
        "whatever clears the fallback sets what is next anew, and a fallen-back collector passes no cloud message",
        (
            Edit(
                "fence.gate",
                "return replace(gate, fell_back=True, next=None, held=_nothing(gate))",
                "return replace(gate, fell_back=True, held=_nothing(gate))",
            ),
        ),
    ),
    "S7": Equivalent(
        "good_s survives a loss",
        "the next attempt forgets the good beat too, before anything judges it",
        (
            Edit(
                "control.robot.changeovers",
                "        situation=replace(robot.situation, good_s=None),\n    )  # fmt: skip\n    if not by_silence:",
                "    )  # fmt: skip\n    if not by_silence:",
            ),
        ),
    ),
    "H1": Equivalent(
        "good beat without echo limit",
        "a late echo is a limit of its own (H11). Removed together: H1+H11",
        (
            Edit(
                "control.robot.health",
                "        and arrived_s - beat.echo.sent_us / 1e6 <= frame.settings.echo_limit_s\n",
                "",
            ),
        ),
    ),
    "H2": Equivalent(
        "good beat without acting",
        "a cloud that does not say that it acts is a limit of its own. Removed together: H2+H21",
        (Edit("control.robot.health", "        and report.acting\n", ""),),
    ),
    "H3": Equivalent(
        "good beat of any epoch",
        "the epoch that the cloud names is a limit of its own. Removed together: H3+H22",
        (Edit("control.robot.health", "        and report.epoch == frame.epoch\n", ""),),
    ),
    "H4": Equivalent(
        "good beat that serves another robot",
        "whom the cloud serves is a limit of its own (H10). Removed together: H4+H10",
        (Edit("control.robot.health", "        and report.serves == frame.incarnation\n", ""),),
    ),
    "H10": Equivalent(
        "identity never judged",
        "a beat that serves another robot is not good (H4). Removed together: H4+H10",
        (
            Edit(
                "control.robot.limits",
                "    Limit(Reason.DUPLICATE_IDENTITY, _R, False, _duplicate_identity),\n    Limit(Reason.NOT_SERVED, _R, False, _not_served),\n",
                "",
            ),
        ),
    ),
    "H8": Equivalent(
        "dead CORE nodes of the cloud ignored",
        "a cloud that is not ready does not say that it acts. Removed together: H2+H8+H21",
        (Edit("control.robot.limits", "    Limit(Reason.CLOUD_NODES_DOWN, _R, True, _cloud_nodes_down),\n", ""),),
    ),
    "G4": Equivalent(
        "unanswered transition counts as done",
        "a node that leaves a transition unanswered leaves reads unanswered too, and is not asked while it is unknown",
        (
            Edit(
                "control.nodes.managed_nodes",
                "        node = replace(node, read_due_s=now_s, state=State.UNKNOWN)\n",
                "",
            ),
        ),
    ),
    "H13": Equivalent(
        "loss timeout doubled",
        "in the cloud good beats are judged besides (H12), before it echoes and the silent control",
        (
            Edit(
                "control.robot.limits",
                "if heard_s is None or not view.silent(heard_s, view.frame.settings.loss_timeout_s):",
                "if heard_s is None or not view.silent(heard_s, 2 * view.frame.settings.loss_timeout_s):",
            ),
        ),
    ),
    "C8": Equivalent(
        "silence never judged",
        "pauses one after the other earn one grace (C17). Removed together: C8+C17",
        (Edit("collector.gate", "PAUSE_S = 0.120", "PAUSE_S = 0.0"),),
    ),
    "Y2": Equivalent(
        "enters the cloud over a bad link",
        "a link that is not good proves nothing, so the cloud is not entered; only the reason shown differs",
        (
            Edit(
                "link.policies",
                "    if not fitness.ok:\n        return Verdict(Site.ROBOT, fitness.reason, fitness.message)\n    left_s = min",
                "    left_s = min",
            ),
        ),
    ),
    **HOT_EQUIVALENT,
}
"""Edits that change nothing that anybody could notice as long as what guards the same stands."""
