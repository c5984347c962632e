# ruff: noqa: E501 - one edit a line
"""Planted faults of Hot standby and of the takeover by silence. Letters: A, the missing message is an absence."""

from __future__ import annotations

from robot_offload_sim.mutants.mutants import Edit, Equivalent, Mutant

HOT: dict[str, Mutant] = {
    "A1": Mutant(
        "margin by those that survived: a message that was taken for lost teaches nothing", "late_message_after_a_takeover",
        (Edit("collector.lateness", "if token != known.token or late_s", "if known.missed or token != known.token or late_s"),),
    ),
    "A2": Mutant(
        "no floor after a mistake", "late_message_after_a_takeover",
        (Edit("collector.lateness", "    if known.missed:\n        newer", "    if False:\n        newer"),),
    ),
    "A3": Mutant(
        "messages that do not pass any more teach nothing", "late_message_after_a_takeover",
        (Edit("collector.gate", "collector = standby.hear(tick(collector, now_s), index, envelope, now_s)\n    state", "collector = tick(collector, now_s)\n    if collector.charge is not None and envelope.token == collector.charge.token:\n        collector = standby.hear(collector, index, envelope, now_s)\n    state"),),
    ),
    "A4": Mutant(
        "a margin without a hundred messages", "hot_robot_before_it_has_learned",
        (Edit("collector.lateness", "    if known.seen < TAUGHT:", "    if False:"),),
    ),
    "A5": Mutant(
        "both silent is a loss", "both_silent_prove_nothing",
        (Edit("collector.standby", "spoke_s is not None and spoke_s > heard_s and now_s", "now_s"),),
    ),
    "A6": Mutant(
        "what is kept of a Hot replica does not pass", "hot_robot_takes_over_by_silence",
        (Edit("collector.standby", "    passing = tuple(i for i, o in enumerate(after.outputs) if _releases(after, o, now_s))", "    passing = ()"),),
    ),
    "A7": Mutant(
        "what is kept passes whatever its age", "newest_messages_of_topics_that_speak_seldom",
        (Edit("collector.standby", "return spec.latched or now_s - output.standby_s <= (spec.period_s or collector.max_age_s)", "return True"),),
    ),
    "A8": Mutant(
        "what is kept passes again", "newest_messages_of_topics_that_speak_seldom",
        (Edit("collector.gate", "standby_new=not ruling.passes", "standby_new=True"),),
    ),
    "A9": Mutant(
        "a latched message has an age", "newest_messages_of_topics_that_speak_seldom",
        (Edit("collector.standby", "return spec.latched or now_s", "return now_s"),),
    ),
    "A10": Mutant(
        "the cloud's latched message has an age", "newest_messages_of_topics_that_speak_seldom",
        (Edit("collector.gate", "latched = envelope.latched and state.spec.latched", "latched = False"),),
    ),
    "A11": Mutant(
        "the cloud begins a stay in silence", "newest_messages_of_topics_that_speak_seldom",
        (Edit("data.cloud", "                self._begin_stay()", "                pass"),),
    ),
    "A12": Mutant(
        "a Warm CORE node beside the Hot one is forgotten", "warm_core_node_beside_a_hot_one",
        (
            Edit("control.robot.process", "hot = bool(core) and all(spec.hot for spec in core)", "hot = any(spec.hot for spec in core)"),
            Edit("control.robot.fast_takeover", "not (robot.hot and robot.nodes_ready)", "not robot.hot"),
        ),
    ),
    "A13": Mutant(
        "mistakes are not counted", "third_mistake_within_ten_minutes",
        (Edit("control.robot.fast_takeover", "    if len(mistakes) < MOST:", "    if True:"),),
    ),
    "A14": Mutant(
        "the rule stays off for ever", "third_mistake_within_ten_minutes",
        (Edit("control.robot.fast_takeover", "if robot.early.off and robot.phase is Phase.CLOUD and", "if False and"),),
    ),
    "A15": Mutant(
        "a confirmed loss counts as a mistake", "hot_robot_takes_over_by_silence",
        (Edit("control.robot.fast_takeover", "    if fault is not None:", "    if False:"),),
    ),
    "A16": Mutant(
        "a takeover by silence closes the sessions", "late_message_after_a_takeover",
        (Edit("control.robot.changeovers", "    if not by_silence:\n", "    if True:\n"),),
    ),
    "A17": Mutant(
        "a takeover by silence ends a wish by hand", "late_message_after_a_takeover",
        (Edit("control.robot.changeovers", "keeps = by_silence or (robot.manual", "keeps = (robot.manual"),),
    ),
    "A18": Mutant(
        "a takeover by silence is a flap", "third_mistake_within_ten_minutes",
        (Edit("control.robot.changeovers", "policy = robot.policy if by_silence else policies.lost", "policy = policies.lost"),),
    ),
    "A20": Mutant(
        "a robot whose mirror ended takes over by silence", "mirror_that_ended_early_keeps_from_a_takeover_by_silence",
        (Edit("control.robot.fast_takeover", " or _unfit(robot)", ""),),
    ),
    "A21": Mutant(
        "only consecutive messages teach: a message lost teaches nothing", "lost_message_that_is_not_sent_again",
        (Edit("collector.lateness", "if token != known.token or late_s", "if token != known.token or sequence != known.sequence + 1 or late_s"),),
    ),
    "A22": Mutant(
        "control's mistakes do not reach the collector", "mistake_teaches_whoever_hears_nothing_more",
        (Edit("collector.standby", "    named = dict(gate.floors)", "    named: dict[int, float] = {}"),),
    ),
    "A23": Mutant(
        "after a mistake no more is waited than before", "mistake_teaches_whoever_hears_nothing_more",
        (Edit("control.robot.fast_takeover", "taken_s - due_s + robot.outputs[index].period_s for", "taken_s - due_s for"),),
    ),
    "A24": Mutant(
        "a mistake is learned from for ever", "mistake_teaches_whoever_hears_nothing_more",
        (Edit("control.robot.fast_takeover", "for floor in robot.early.floors if now_s < floor.until_s)", "for floor in robot.early.floors)"),),
    ),
    "A25": Mutant(
        "what the mistakes have taught is forgotten when the rule is used again", "third_mistake_within_ten_minutes",
        (Edit("control.robot.fast_takeover", "early=Early(floors=robot.early.floors))", "early=Early())"),),
    ),
}  # fmt: skip
HOT_EQUIVALENT: dict[str, Equivalent] = {
    "A19": Equivalent(
        "a collector that stood still judges at once", "the shell reads all that has arrived before it looks, which dates the messages after the pause",
        (Edit("collector.standby", "return max(late.arrived_s + spec.period_s + margin_s, collector.judged_from_s)", "return late.arrived_s + spec.period_s + margin_s"),),
    ),
}  # fmt: skip
