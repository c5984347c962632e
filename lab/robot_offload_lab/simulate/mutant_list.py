# ruff: noqa: E501
"""The planted faults: what each does wrong, the edit, and the stories that find it. Docs: docs/simulation.md."""

from __future__ import annotations

from robot_offload_lab.simulate.mutants import Edit, Mutant

MUTANTS: dict[str, Mutant] = {
    "L1": Mutant(
        "pause does not void old echoes",
        (Edit("lease", "cloud.void_before_s <= echo.sent_us / 1e6 <= now_s", "echo.sent_us / 1e6 <= now_s"),),
    ),
    "L2": Mutant("pause never noticed", (Edit("lease", "PAUSE_LIMIT_S = 0.150", "PAUSE_LIMIT_S = 1e9"),)),
    "L3": Mutant(
        "takes grants for another cloud",
        (
            Edit(
                "lease",
                "if not isinstance(permission, Permission) or permission.cloud != cloud.incarnation:",
                "if not isinstance(permission, Permission):",
            ),
        ),
    ),
    "L4": Mutant(
        "older epoch's grant renews",
        (Edit("lease", "    if permission.epoch < cloud.epoch:\n        return cloud\n", ""),),
    ),
    "L5": Mutant(
        "lease carries over to a newer epoch",
        (
            Edit(
                "lease",
                "cloud = replace(cloud, epoch=permission.epoch, granted=False, lease_end_s=0.0)",
                "cloud = replace(cloud, epoch=permission.epoch)",
            ),
        ),
    ),
    "L6": Mutant(
        "second robot served at once",
        (
            Edit(
                "lease",
                "if cloud.robot and (now_s - cloud.robot_s <= ROBOT_LIVE_S or holds_lease(cloud, now_s)):",
                "if False:",
            ),
        ),
    ),
    "L7": Mutant(
        "lease length of the grant ignored",
        (Edit("lease", "min(cloud.settings.lease_s, permission.lease_us / 1e6)", "cloud.settings.lease_s"),),
    ),
    "L8": Mutant(
        "lease 10 % too long",
        (
            Edit(
                "lease",
                "end_s = echo.sent_us / 1e6 + min(cloud.settings.lease_s, permission.lease_us / 1e6)",
                "end_s = echo.sent_us / 1e6 + 1.1 * min(cloud.settings.lease_s, permission.lease_us / 1e6)",
            ),
        ),
    ),
    "L9": Mutant(
        "robot beats in any order",
        (Edit("lease", "    if beat.sent_us <= cloud.robot_sent_us:\n        return cloud\n", ""),),
    ),
    "L10": Mutant(
        "says acting before its nodes are ready", (Edit("lease", "acting=held and cloud.ready,", "acting=held,"),)
    ),
    "L11": Mutant(
        "ungranted permission renews", (Edit("lease", "    if not permission.granted:\n        return cloud\n", ""),)
    ),
    "L12": Mutant(
        "echo of another incarnation grants",
        (Edit("lease", "if echo is None or echo.incarnation != cloud.incarnation:", "if echo is None:"),),
    ),
    "L13": Mutant(
        "robot never forgotten",
        (
            Edit(
                "lease",
                "if cloud.robot and now_s - cloud.robot_s > ROBOT_LIVE_S and not holds_lease(cloud, now_s):",
                "if False:",
            ),
        ),
    ),
    "P1": Mutant("permission stands for 4 beats", (Edit("pulse", "PERMISSION_BEATS = 2", "PERMISSION_BEATS = 4"),)),
    "P2": Mutant(
        "any order of beats",
        (
            Edit(
                "pulse",
                "    if known is not None and beat.sent_us <= known.sent_us:\n        return pulse, False\n",
                "",
            ),
        ),
    ),
    "P3": Mutant(
        "foreign uid heard",
        (Edit("pulse", "if beat.uid != pulse.uid or beat.sender is pulse.side", "if beat.sender is pulse.side"),),
    ),
    "P4": Mutant("own side's beats heard", (Edit("pulse", "beat.sender is pulse.side or ", ""),)),
    "P5": Mutant(
        "order by sequence", (Edit("pulse", "beat.sent_us <= known.sent_us", "beat.sequence <= known.sequence"),)
    ),
    "P6": Mutant(
        "echoes the last heard, not the partner",
        (
            Edit(
                "pulse",
                "return matching or (pulse.heard[-1] if pulse.heard else None)",
                "return pulse.heard[-1] if pulse.heard else None",
            ),
        ),
    ),
    "P7": Mutant(
        "hold time not counted",
        (Edit("pulse", "hold_us = max(0, round((now_s - heard.arrived_s) * 1e6))", "hold_us = 0"),),
    ),
    "P8": Mutant(
        "permission age counted from reading",
        (Edit("pulse", "spoken_s=said_s)", "spoken_s=max(said_s, pulse.spoken_s or 0.0))"),),
    ),
    "C1": Mutant(
        "no BeforeRestart",
        (
            Edit(
                "collectors",
                "if collector.resumed_s is not None and envelope.echo_us / 1e6 < collector.resumed_s:",
                "if False:",
            ),
        ),
    ),
    "C2": Mutant(
        "negative age passes",
        (
            Edit(
                "collectors",
                "if not 0 <= envelope.age_s(now_s) <= collector.max_age_s:",
                "if not envelope.age_s(now_s) <= collector.max_age_s:",
            ),
        ),
    ),
    "C3": Mutant(
        "sequence starts anew at a changeover",
        (Edit("collectors", "last_sequence=o.next_sequence if charge == collector.next else -1", "last_sequence=-1"),),
    ),
    "C4": Mutant(
        "fallen-back epoch of the cloud goes on",
        (
            Edit(
                "collectors",
                "        if collector.fell_back and ours.site is Site.CLOUD:\n            return collector  # robot messages have passed since: only a new epoch may follow\n",
                "",
            ),
        ),
    ),
    "C5": Mutant(
        "fallback keeps what is next",
        (
            Edit(
                "collectors",
                "after = replace(collector, fell_back=True, next=None)",
                "after = replace(collector, fell_back=True)",
            ),
        ),
    ),
    "C6": Mutant(
        "effects after fallback",
        (
            Edit(
                "collectors",
                "    if collector.fell_back or charge is None or collector.gate_s is None:\n        return Passage",
                "    if charge is None or collector.gate_s is None:\n        return Passage",
            ),
        ),
    ),
    "C7": Mutant(
        "earlier control heard",
        (Edit("collectors", "    if gate.started_us < collector.started_us:\n        return collector\n", ""),),
    ),
    "C8": Mutant("silence never judged", (Edit("collectors", "PAUSE_S = 0.120", "PAUSE_S = 0.0"),)),
    "C9": Mutant(
        "one rated output that flows is enough",
        (
            Edit(
                "collectors",
                "all(map(robot_flows, rated)), all(map(cloud_flows, rated))",
                "any(map(robot_flows, rated)), any(map(cloud_flows, rated))",
            ),
        ),
    ),
    "C10": Mutant(
        "Hot robot passes while the cloud acts",
        (
            Edit(
                "collectors",
                "return collector, Passage(Ruling.CLOUD_IN_CHARGE)",
                "return collector, Passage(Ruling.ROBOT_IN_CHARGE)",
            ),
        ),
    ),
    "C11": Mutant(
        "held messages of any age", (Edit("collectors", " and now_s - o.next_born_s <= collector.max_age_s\n", "\n"),)
    ),
    "C12": Mutant(
        "repeats of the next side",
        (
            Edit(
                "collectors",
                "        if envelope.sequence <= state.next_sequence:\n            return collector, Passage(Ruling.REORDERED)\n",
                "",
            ),
        ),
    ),
    "C13": Mutant(
        "passes the cloud before control spoke",
        (
            Edit(
                "collectors",
                "    if collector.fell_back or collector.charge is None or collector.gate_s is None:\n        return collector, Passage(Ruling.CONTROL_SILENT)\n    if not 0",
                "    if collector.fell_back or collector.charge is None:\n        return collector, Passage(Ruling.CONTROL_SILENT)\n    if not 0",
            ),
        ),
    ),
    "C14": Mutant(
        "fallback forgotten at restart",
        (Edit("collectors", "fell_back=fell_back, resumed_s=now_s)", "fell_back=False, resumed_s=now_s)"),),
    ),
    "C15": Mutant(
        "resumed collector waits for control for ever",
        (
            Edit(
                "collectors",
                "spoken_s = collector.resumed_s if collector.gate_s is None else collector.gate_s",
                "spoken_s = collector.gate_s",
            ),
        ),
    ),
    "C16": Mutant(
        "gate timeout doubled",
        (
            Edit(
                "collectors",
                "now_s - spoken_s <= collector.gate_timeout_s:",
                "now_s - spoken_s <= 2 * collector.gate_timeout_s:",
            ),
        ),
    ),
    "S1": Mutant(
        "clear without the lease",
        (
            Edit(
                "switcher",
                "return revoked_s + PERMISSION_BEATS * settings.beat_period_s + settings.lease_s + settings.drift_s",
                "return revoked_s + PERMISSION_BEATS * settings.beat_period_s",
            ),
        ),
    ),
    "S2": Mutant(
        "clear without the two beats",
        (
            Edit(
                "switcher",
                "return revoked_s + PERMISSION_BEATS * settings.beat_period_s + settings.lease_s + settings.drift_s",
                "return revoked_s + settings.lease_s + settings.drift_s",
            ),
        ),
    ),
    "S3": Mutant(
        "calling off keeps the epoch",
        (Edit("switcher", "    if phase is Phase.ROBOT:  # the candidate may", "    if False:  # the candidate may"),),
    ),
    "S4": Mutant(
        "effects while the changeover is offered",
        (
            Edit(
                "switcher",
                "    if robot.preparation is not None and robot.preparation.offered:\n        return None  # the collector may change over at any moment, and we hear of it later\n",
                "",
            ),
        ),
    ),
    "S5": Mutant(
        "a stranger takes the place of a live cloud", (Edit("switcher", "if stranger and live:", "if False:"),)
    ),
    "S6": Mutant("no Reopen at a loss", (Edit("switcher", "    commands.append(Reopen(fault.reason))\n", ""),)),
    "S7": Mutant(
        "good_s survives a loss",
        (
            Edit(
                "switcher",
                "        situation=replace(robot.situation, good_s=None),\n    )  # fmt: skip\n    commands.append(Reopen",
                "    )  # fmt: skip\n    commands.append(Reopen",
            ),
        ),
    ),
    "S8": Mutant(
        "robot armed before its nodes are ready",
        (
            Edit(
                "switcher",
                "preparation=replace(preparation, armed=robot.nodes_ready)",
                "preparation=replace(preparation, armed=True)",
            ),
        ),
    ),
    "S9": Mutant("no wait between attempts", (Edit("switcher", "RETRY_FIRST_S = 1.0", "RETRY_FIRST_S = 0.0"),)),
    "S10": Mutant(
        "by hand in spite of faults",
        (
            Edit(
                "switcher",
                '        if fault is not None:\n            return robot, False, f"Refused ({fault.reason}): {fault.message}"\n',
                "",
            ),
        ),
    ),
    "S11": Mutant(
        "min_dwell ignored",
        (
            Edit(
                "switcher",
                "dwelt = now_s - robot.charged_s >= robot.settings.min_dwell_s or verdict.reason.urgent",
                "dwelt = True",
            ),
        ),
    ),
    "S12": Mutant(
        "nodes not woken in TAKEOVER",
        (
            Edit(
                "switcher",
                "acting=robot.phase is not Phase.CLOUD,",
                "acting=robot.phase not in (Phase.CLOUD, Phase.TAKEOVER),",
            ),
        ),
    ),
    "S13": Mutant(
        "robot's silent outputs never stop the driver",
        (Edit("switcher", "    return gate is not None and gate.robot_flows\n", "    return True\n"),),
    ),
    "S14": Mutant(
        "dead collector counts as acting",
        (
            Edit(
                "switcher",
                "    if now_s - (started_s if reported_s is None else reported_s) > robot.settings.lease_s:\n        return now_s < robot.stalls.until_s and not _starved(robot, now_s)  # its reports may still be unread\n",
                "",
            ),
        ),
    ),
    "S15": Mutant(
        "wish for the cloud survives a loss",
        (
            Edit(
                "switcher",
                "manual = robot.manual if robot.manual is not None and robot.manual.site is Site.ROBOT else None",
                "manual = robot.manual",
            ),
        ),
    ),
    "S16": Mutant(
        "retry wait holds a robot that stands still",
        (
            Edit(
                "switcher",
                "hurried_s = robot.retry_s if robot.both_silent else robot.since_s + RETRY_FIRST_S",
                "hurried_s = robot.retry_s",
            ),
        ),
    ),
    "S17": Mutant(
        "robot unable is never helped",
        (
            Edit(
                "switcher",
                "if fault is None and _in_need(robot, verdict, now_s)",
                "if False and _in_need(robot, verdict, now_s)",
            ),
        ),
    ),
    "S18": Mutant(
        "no deadline for the robot to get ready",
        (
            Edit(
                "switcher",
                "    if now_s >= preparation.deadline_s:\n        message",
                "    if False:\n        message",
            ),
        ),
    ),
    "S19": Mutant(
        "begins on old news after a stall",
        (Edit("switcher", "    if now_s < robot.stalls.until_s:  # what", "    if False:  # what"),),
    ),
    "S20": Mutant(
        "another cloud's charge taken as ours",
        (
            Edit(
                "switcher",
                "charge is not None and charge.token.robot == robot.incarnation and charge",
                "charge is not None and charge",
            ),
        ),
    ),
    "H1": Mutant(
        "good beat without echo limit",
        (Edit("health", "        and arrived_s - beat.echo.sent_us / 1e6 <= frame.settings.echo_limit_s\n", ""),),
    ),
    "H2": Mutant("good beat without acting", (Edit("health", "        and report.acting\n", ""),)),
    "H3": Mutant("good beat of any epoch", (Edit("health", "        and report.epoch == frame.epoch\n", ""),)),
    "H4": Mutant(
        "good beat that serves another robot", (Edit("health", "        and report.serves == frame.incarnation\n", ""),)
    ),
    "H5": Mutant(
        "stale inputs of the cloud ignored",
        (Edit("limits", "    Limit(Reason.INPUT_STALE, _R, False, _input_stale),\n", ""),),
    ),
    "H6": Mutant(
        "silent outputs of the cloud ignored",
        (Edit("limits", "    Limit(Reason.OUTPUT_SILENT, _R, True, _output_silent),\n", ""),),
    ),
    "H7": Mutant(
        "data session never judged",
        (
            Edit(
                "limits",
                "    Limit(Reason.DATA_PROCESS_SILENT, _S, False, _data_process_silent),\n    Limit(Reason.DATA_DISCONNECTED, _R, False, _data_disconnected),\n    Limit(Reason.DATA_SILENT, _S, False, _data_silent),\n    Limit(Reason.DATA_MISMATCH, _R, False, _data_mismatch),\n    Limit(Reason.DATA_UNHEARD, _R, False, _data_unheard),\n",
                "",
            ),
        ),
    ),
    "H8": Mutant(
        "dead CORE nodes of the cloud ignored",
        (Edit("limits", "    Limit(Reason.CLOUD_NODES_DOWN, _R, True, _cloud_nodes_down),\n", ""),),
    ),
    "H9": Mutant(
        "collector never judged",
        (
            Edit(
                "limits",
                "    Limit(Reason.COLLECTOR_SILENT, _S, False, _collector_silent),\n    Limit(Reason.COLLECTOR_FELL_BACK, _R, False, _collector_fell_back),\n",
                "",
            ),
        ),
    ),
    "H10": Mutant(
        "identity never judged",
        (
            Edit(
                "limits",
                "    Limit(Reason.DUPLICATE_IDENTITY, _R, False, _duplicate_identity),\n    Limit(Reason.NOT_SERVED, _R, False, _not_served),\n",
                "",
            ),
        ),
    ),
    "H11": Mutant(
        "late echoes ignored", (Edit("limits", "    Limit(Reason.ECHO_STALE, _S, False, _echo_stale),\n", ""),)
    ),
    "H12": Mutant(
        "good beats never judged",
        (Edit("limits", "    Limit(Reason.CLOUD_NOT_ACTING, _S, True, _no_good_beat),\n", ""),),
    ),
    "H13": Mutant(
        "loss timeout doubled",
        (
            Edit(
                "limits",
                "if heard_s is None or not view.silent(heard_s, view.frame.settings.loss_timeout_s):",
                "if heard_s is None or not view.silent(heard_s, 2 * view.frame.settings.loss_timeout_s):",
            ),
        ),
    ),
    "H14": Mutant(
        "stall grace without end",
        (
            Edit(
                "limits",
                "    if acting and view.silent(view.situation.good_s, view.frame.settings.lease_s):",
                "    if False:",
            ),
        ),
    ),
    "H15": Mutant(
        "pulse and data at different clouds",
        (Edit("limits", "    Limit(Reason.DATA_MISMATCH, _R, False, _data_mismatch),\n", ""),),
    ),
    "H16": Mutant(
        "silent cloud control ignored",
        (
            Edit(
                "limits",
                "broken = view.report is None or age_s is None or age_s > view.frame.settings.loss_timeout_s",
                "broken = view.report is None",
            ),
        ),
    ),
    "H17": Mutant(
        "what was reported waits for the end of a stall",
        (
            Edit(
                "limits",
                "if (limit.only_acting and not acting) or (stalled and limit.basis is Basis.SILENCE):",
                "if (limit.only_acting and not acting) or stalled:",
            ),
        ),
    ),
    "H18": Mutant("a starved control waits for ever", (Edit("limits", "    if view.frame.starved:", "    if False:"),)),
    "W1": Mutant(
        "pins ignored",
        (
            Edit(
                "wishes",
                "    if robot.pin is not None and robot.pin.holds(now_s):\n        return robot.pin.site\n",
                "",
            ),
        ),
    ),
    "W2": Mutant(
        "clock offset ignored", (Edit("wishes", "fault = clock_fault(robot.link, robot.settings)", "fault = None"),)
    ),
    "W3": Mutant(
        "by hand ignored", (Edit("wishes", "if robot.manual is not None and robot.manual.holds(now_s):", "if False:"),)
    ),
    "K1": Mutant("echo from the future gives a round trip", (Edit("links", "if round_trip_s < 0 or (", "if ("),)),
    "K2": Mutant(
        "overdue echoes do not count as latency",
        (
            Edit(
                "links",
                "return max(link.round_trip_s, now_s - link.echo_sent_s - 2 * beat_period_s)",
                "return link.round_trip_s",
            ),
        ),
    ),
    "T1": Mutant("no drift margin", (Edit("settings", "return self.lease_s * DRIFT_SHARE + 0.001", "return 0.0"),)),
    "T2": Mutant(
        "settings change at once",
        (
            Edit(
                "settling",
                "    held = replace(asked, lease_s=max(present.lease_s, asked.lease_s))\n",
                "    return asked\n    held = replace(asked, lease_s=max(present.lease_s, asked.lease_s))\n",
            ),
        ),
    ),
    "E1": Mutant(
        "envelope decodes the epoch one too high",
        (
            Edit(
                "envelope",
                'token = Token("" if robot == ABSENT else robot.hex(), epoch,',
                'token = Token("" if robot == ABSENT else robot.hex(), epoch + 1,',
            ),
        ),
    ),
    "Y1": Mutant(
        "hold-down ignored",
        (Edit("policies", "left_s = min(policy.hold_until_s - now_s, PROVEN_S - policy.good_s)", "left_s = 0.0"),),
    ),
    "Y2": Mutant(
        "enters the cloud over a bad link",
        (
            Edit(
                "policies",
                "    if not fitness.ok:\n        return Verdict(Site.ROBOT, fitness.reason, fitness.message)\n    left_s = min",
                "    left_s = min",
            ),
        ),
    ),
    "G1": Mutant(
        "nodes do not wait for each other",
        (Edit("guardians", "waits_core = waits_core or (node.spec.core and _rises(node))", "waits = False"),),
    ),
    "G2": Mutant(
        "one CORE node is enough",
        (
            Edit(
                "guardians",
                "return all(_stays_active(n) or not n.spec.lifecycle for n in core)",
                "return any(_stays_active(n) or not n.spec.lifecycle for n in core)",
            ),
        ),
    ),
    "G3": Mutant(
        "ready while being put to sleep",
        (
            Edit(
                "guardians",
                "return node.state is State.ACTIVE and node.asked is not Transition.DEACTIVATE",
                "return node.state is State.ACTIVE",
            ),
        ),
    ),
    "G4": Mutant(
        "unanswered transition counts as done",
        (Edit("guardians", "        node = replace(node, read_due_s=now_s, state=State.UNKNOWN)\n", ""),),
    ),
    "G5": Mutant("gives up after 1 s", (Edit("guardians", "GIVE_UP_S = 60.0", "GIVE_UP_S = 1.0"),)),
    "G6": Mutant(
        "inhibit is said once",
        (
            Edit(
                "guardians",
                "repeat = (inhibit or guardian.inhibited is not inhibit) and now_s >= guardian.inhibit_due_s",
                "repeat = False",
            ),
        ),
    ),
    "G7": Mutant(
        "dead CORE nodes of the robot do not stop the driver",
        (
            Edit(
                "guardians",
                '            return f"CORE node {node.spec.name} is {node.state.value}"\n',
                "            continue\n",
            ),
        ),
    ),
    "G8": Mutant("nodes are never read again", (Edit("guardians", "READ_PERIOD_S = 1.0", "READ_PERIOD_S = 1e9"),)),
    "G9": Mutant(
        "silence never stops the driver",
        (Edit("guardians", "return guardian.in_charge and not guardian.outputs_flow", "return False"),),
    ),
    "G10": Mutant(
        "grace ten times as long",
        (Edit("guardians", "now_s - since_s >= guardian.grace_s or", "now_s - since_s >= 10 * guardian.grace_s or"),),
    ),
    "G11": Mutant(
        "duplicated nodes never put to sleep",
        (Edit("guardians", "active = not node.spec.duplicated or guardian.acting or node.spec.hot", "active = True"),),
    ),
}
