"""The settings that the robot has taken last, on its disk: used at a start without the cloud.

Each process of the robot reads them at its own start. Unreadable settings, and those that the robot's file no longer
allows, are reported and left out: they never keep the robot from starting.
"""

from __future__ import annotations

import json
from pathlib import Path

from robot_offload_agent.settings.files import read_text, write_whole
from robot_offload_agent.settings.offer import Offer, judge
from robot_offload_agent.settings.override import state_dir
from robot_offload_agent.settings.parameters import Configuration

VERSION = 1
Problem = tuple[str, str]


def path(configuration: Configuration) -> Path:
    """Return the file."""
    return state_dir(configuration) / "settings.json"


def keep(configuration: Configuration, offer: Offer) -> None:
    """Write an offer that was taken; raise OSError if it cannot be stored."""
    body = {
        "version": VERSION, "uid": configuration["uid"], "generation": offer.generation,
        "parameters": dict(offer.parameters),
    }  # fmt: skip
    write_whole(path(configuration), json.dumps(body, indent=1), durable=True)


def load(configuration: Configuration) -> tuple[Configuration, Offer | None, Problem | None]:
    """Return (configuration in force, the kept offer that is in it, what is wrong with the kept file)."""
    where = path(configuration)
    try:
        body = json.loads(read_text(where))
        if body["version"] != VERSION or body["uid"] != configuration["uid"]:
            raise ValueError("of another version, or of another robot")
        generation, parameters = body["generation"], body["parameters"]
        if type(generation) is not int or not isinstance(parameters, dict):
            raise ValueError("a generation and parameters are expected")
    except FileNotFoundError:
        return configuration, None, None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        message = f"{where} is damaged ({error}); the robot runs its own file until the cloud offers settings again"
        return configuration, None, ("KeptSettingsDamaged", message)
    offer = Offer(generation, parameters)
    if generation < configuration["generation"]:
        return configuration, None, None  # a newer bundle was installed since
    judgement = judge(configuration, generation, offer)
    if judgement.configuration is None:
        message = f"{where} is left out ({judgement.reason}): {judgement.message}"
        return configuration, None, ("KeptSettingsRefused", message)
    return judgement.configuration, offer, None


def in_force(configuration: Configuration) -> Configuration:
    """Return the settings that hold at the start of a process of this side."""
    return load(configuration)[0] if configuration["side"] == "robot" else configuration
