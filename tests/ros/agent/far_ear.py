"""An ear in a network namespace: the same node in a process of its own, told and asked in JSON lines.

It must be a process of its own because Fast DDS reads the interfaces of the host once per process.
"""

import dataclasses
import json
import queue
import sys
import threading
import time
from typing import Any

from robot_offload_lab.judge.recording import Arrival, PlacementChange
from tests.ros.agent.ears import CALL_S, INHIBIT, Ear, Status
from tests.ros.agent.processes import Processes

TELL_S = 0.01


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a service said; `message` of a Trigger and `reason` of a parameter are the same thing here."""

    success: bool
    message: str

    @property
    def successful(self) -> bool:
        return self.success

    @property
    def reason(self) -> str:
        return self.message


class FarEar:
    """The test's end. It offers what the tests over DDS need of an `Ear`."""

    def __init__(
        self,
        processes: Processes,
        domain: int,
        namespace: str,
        topic: str,
        environment: dict[str, str] | None = None,
    ) -> None:
        self.heard: list[Arrival] = []
        self.placed: list[PlacementChange] = []
        self.diagnostics: dict[str, Status] = {}
        self.orders: list[tuple[float, bool]] = []
        self.answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        command = [sys.executable, "-m", __name__, str(domain), topic]
        self.process = processes.start("far-ear", command, namespace, environment, talks=True)
        self.thread = threading.Thread(target=self._listen, name="far-ear", daemon=True)
        self.thread.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if not line.endswith(b"\n"):
                return  # killed in the middle of a line
            kind, body = json.loads(line)
            if kind == "arrival":
                self.heard.append(Arrival(*body))
            elif kind == "placed":
                self.placed.append(PlacementChange(*body))
            elif kind == "status":
                self.diagnostics[body[0]] = Status(*body[1:])
            elif kind == "order":
                self.orders.append((body[0], body[1]))
            else:
                self.answers.put(Answer(*body))

    def arrivals(self, _topic: str) -> list[Arrival]:
        return self.heard

    def placements(self) -> list[PlacementChange]:
        return self.placed

    def inhibit_orders(self, _service: str) -> list[tuple[float, bool]]:
        return self.orders

    def trigger(self, name: str) -> Answer:
        return self._ask("trigger", name)

    def set_parameter(self, node: str, name: str, value: str | float | bool) -> Answer:
        return self._ask("set_parameter", node, name, value)

    def say(self, topic: str, frame_id: str, patience_s: float = CALL_S) -> Answer:
        """Publishes one Header, as soon as somebody hears it."""
        return self._ask("say", topic, frame_id, patience_s)

    def _ask(self, *words: Any) -> Answer:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(words).encode() + b"\n")
        self.process.stdin.flush()
        return self.answers.get(timeout=2 * CALL_S)

    def close(self) -> None:
        """Ends the process, unless it was killed with the others."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.kill()
        self.process.stdin.close()
        self.thread.join(CALL_S)
        self.process.stdout.close()


def main(domain: int, topic: str) -> None:
    """The far end."""
    ear = Ear(domain, "ear")
    told: dict[str, list[Any]] = {
        "arrival": ear.arrivals(topic), "placed": ear.placements(), "order": ear.inhibit_orders(INHIBIT),
    }  # fmt: skip
    ear.feed("/odom", 20.0)
    latch = ear.latch("/map", "a map")
    threading.Thread(target=obey, args=(ear,), daemon=True).start()
    counts = dict.fromkeys(told, 0)
    known: dict[str, float] = {}
    while latch is not None:
        for kind, found in told.items():
            for entry in found[counts[kind] :]:
                counts[kind] += 1
                say(kind, list(entry) if isinstance(entry, tuple) else list(dataclasses.asdict(entry).values()))
        for name, status in list(ear.diagnostics.items()):
            if known.get(name) != status.t_s:
                known[name] = status.t_s
                say("status", [name, *dataclasses.asdict(status).values()])
        time.sleep(TELL_S)


def obey(ear: Ear) -> None:
    for line in sys.stdin:
        what, *words = json.loads(line)
        try:
            if what == "say":
                ear.say(*words)
                say("answer", [True, ""])
                continue
            answer = ear.trigger(*words) if what == "trigger" else ear.set_parameter(*words)
        except AssertionError as error:
            say("answer", [False, str(error)])
            continue
        say("answer", [answer.success, answer.message] if what == "trigger" else [answer.successful, answer.reason])


def say(kind: str, body: list[Any]) -> None:
    sys.stdout.write(json.dumps([kind, body]) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
