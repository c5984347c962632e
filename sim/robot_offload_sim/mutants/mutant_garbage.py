"""Planted faults of the border: what is read although it is of another version, or says nothing that ours would."""

from __future__ import annotations

from robot_offload_sim.mutants.mutants import Edit, Mutant

STORY = "garbage_in_every_channel"
GARBAGE: dict[str, Mutant] = {
    "E2": Mutant("headers of another version are read", STORY, (Edit("fence.envelope", "magic != MAGIC or ", ""),)),
    "E3": Mutant(
        "beats of another version are read",
        STORY,
        (Edit("words.beats", "if version not in (VERSION, PREVIOUS):", "if False:"),),
    ),
    "E4": Mutant(
        "probes of another version are read", STORY,
        (Edit("data.probe", 'if body.get("v") != VERSION:', "if False:"),),
    ),
    "E5": Mutant(
        "frames of another version are read", STORY, (Edit("relay.goals.words", "if magic != MAGIC:", "if False:"),)
    ),
    "E6": Mutant(
        "an echo of nobody may say anything", "garbage_beside_bare_beats",
        (Edit("words.beats", "for _ in range(3)] != 3 * [NONE]:", "for _ in range(3)] == []:"),),
    ),
    "E7": Mutant(
        "garbage among the letters ends the relay's turn", STORY,
        (Edit("relay.post", "        except WordError as error:\n", "        except KeyError as error:\n"),),
    ),
}  # fmt: skip
