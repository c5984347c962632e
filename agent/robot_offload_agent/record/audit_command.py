"""`robot-offload-agent audit verify|export --params FILE`: checks or prints the audit trail of this robot."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from robot_offload_agent.errors import AgentError
from robot_offload_agent.record.audit import FOLDER, lines
from robot_offload_agent.settings.override import state_dir
from robot_offload_agent.settings.parameters import load
from robot_offload_core.record import audit

EPILOG = """\
examples:
  robot-offload-agent audit verify --params agent.yaml
  robot-offload-agent audit verify --params agent.yaml --head 41:5b1f...    a head that was kept elsewhere
  robot-offload-agent audit export --params agent.yaml > audit.json

exit codes: 0 the trail is one chain, 1 it was altered, cannot be read or is in part of another version, 2 bad words
"""


def main(words: list[str]) -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="robot-offload-agent audit", description=__doc__, epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("what", choices=("verify", "export"))
    parser.add_argument("--params", type=Path, required=True, metavar="FILE", help="the robot's agent.yaml")
    parser.add_argument("--head", default="", metavar="NUMBER:DIGEST", help="an entry that was seen before")
    options = parser.parse_args(words)
    known = audit.parse_head(options.head) if options.head else None
    if options.head and known is None:
        parser.error("--head: write NUMBER:DIGEST as `audit verify` prints it")
    try:
        found = lines(state_dir(load(options.params)) / FOLDER)
    except (AgentError, OSError) as error:
        sys.stderr.write(f"robot-offload-agent: {error}\n")
        return getattr(error, "exit_code", 1)
    if options.what == "export":
        sys.stdout.write(json.dumps(audit.exported(found), indent=1) + "\n")
        return 0
    verdict = audit.verify(found, known)
    sys.stdout.write("\n".join(audit.sentences(verdict)) + "\n")
    return 1 if verdict.problems or verdict.others else 0
