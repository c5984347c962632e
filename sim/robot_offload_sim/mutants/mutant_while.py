# ruff: noqa: E501 - one edit a line
"""Planted faults of outputs that are rated only while there is something to do. Letter: B, busy."""

from __future__ import annotations

from robot_offload_sim.mutants.mutants import Edit, Mutant

WHILE: dict[str, Mutant] = {
    "B1": Mutant(
        "an idle side is silent", "idle_robot_changes_over",
        (Edit("collector.active_while", "    if since_s is None:\n        return False\n", "    if since_s is None:\n        return True\n"),),
    ),
    "B2": Mutant(
        "an idle side is waited for", "idle_robot_changes_over",
        (Edit("collector.active_while", "(spec.while_ is None or since_s is not None)", "True"),),
    ),
    "B3": Mutant(
        "nobody waits for the first message of a side that executes", "changeover_while_a_goal_runs",
        (Edit("collector.active_while", "(spec.while_ is None or since_s is not None)", "spec.while_ is None"),),
    ),
    "B4": Mutant(
        "a side that never begins is not silent", "silent_from_the_beginning",
        (Edit("collector.active_while", " or now_s >= since_s + activation_s", ""),),
    ),
    "B5": Mutant(
        "the beat does not say what the cloud executes", "silent_while_it_executes",
        (Edit("control.cloud.process", "rated=self._bits()))\n\n    def _note", "rated=0))\n\n    def _note"), Edit("control.cloud.process", "if self.cloud_data is not None and self._bits()", "if False and self._bits()")),
    ),
    "B6": Mutant(
        "the last word of a dead relay counts", "robot_silent_while_it_executes",
        (Edit("control.process", "executing = () if self.unjudged() else self.executing", "executing = self.executing"),),
    ),
    "B7": Mutant(
        "the end of a goal is a lost message", "end_of_a_goal_is_no_loss",
        (Edit("control.robot.fast_takeover", "    if robot.outputs[index].while_ is None:\n", "    if True:\n"),),
    ),
    "B8": Mutant(
        "an idle robot is not heard, so its inhibit stays", "robot_silent_while_it_executes",
        (Edit("control.robot.levels", "        due -= set(gate.idle)\n", "        pass\n"),),
    ),
    "B9": Mutant(
        "a topic counts for ever", "rated_while_a_topic_arrives",
        (Edit("data.process", "came_s is not None and now_s - came_s <= condition.within_s", "came_s is not None"),),
    ),
}  # fmt: skip
