#!/usr/bin/env python3
"""Knocks at the door of a robot's cloud with somebody's certificate, and listens to all that the cloud shows it.

    knocking.py AGENT_YAML CERTIFICATES [--fallback] [--patience SECONDS]

AGENT_YAML is the robot's configuration, by which its cloud is found; CERTIFICATES is a folder with `robot.pem` and
`robot.key`. Tells in JSON whether the session opened, and which keys were heard in it.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import zenoh

from robot_offload_agent.link.zenoh_config import KEY_PREFIX, session_config
from robot_offload_agent.link.zenoh_configured import zenoh_settings
from robot_offload_agent.settings.parameters import load

LISTEN_S = 5.0


def knock(config: zenoh.Config, prefix: str, patience_s: float) -> dict[str, object]:
    """Opens a session and listens in it; tries again for as long as the patience lasts."""
    end_s = time.monotonic() + patience_s
    while True:
        try:
            session = zenoh.open(config)
            break
        except zenoh.ZError as error:
            if time.monotonic() > end_s:
                return {"opened": False, "heard": [], "why": str(error)}
            time.sleep(0.2)
    keys: set[str] = set()
    for wanted in (f"{KEY_PREFIX}/**", f"{prefix}/cloud/data/**", f"{prefix}/robot/data/**"):
        session.declare_subscriber(wanted, lambda sample: keys.add(str(sample.key_expr)))
    time.sleep(LISTEN_S)
    session.close()  # type: ignore[no-untyped-call]  # the wheel's stubs have no type for it
    return {"opened": True, "heard": sorted(keys), "why": ""}


def main() -> None:
    """Tries until the session opens or the patience is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("agent_yaml", type=Path)
    parser.add_argument("certificates", type=Path)
    parser.add_argument("--fallback", action="store_true")
    parser.add_argument("--patience", type=float, default=15.0)
    chosen = parser.parse_args()
    own = zenoh_settings(load(chosen.agent_yaml), "data")
    settings = replace(
        own,
        certificate=str(chosen.certificates / "robot.pem"),
        private_key=str(chosen.certificates / "robot.key"),
        open_timeout_ms=2000,
    )
    wanted = session_config(settings, fallback=chosen.fallback)
    del wanted["access_control"]  # who comes with bad intent has no rules of ours
    config = zenoh.Config.from_json5(json.dumps(wanted))
    found = knock(config, f"{KEY_PREFIX}/{settings.uid}", chosen.patience)
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
