"""The words that robot, cloud and their processes exchange.

Here is what several rooms need to name: tokens, messages between processes, heartbeats and their text form, the
envelope of a carried message, settings, reasons, problems. A word is a frozen dataclass, an enumeration or a constant,
with the functions that check, encode and decode it.

Never here: a decision, a state machine, a word that only one room uses. The room imports nothing of the core, and
serves all five processes.
"""
