"""Notes that the two control processes exchange besides beats: settings and their answer, and a cloud that leaves.

Notes travel as text in the probes of the data session, ten times a second on every kind of link. They are levels: each
states all that holds now, so a lost one does no harm. Pure.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field, replace
from typing import Any

from robot_offload_agent.settings.offer import Offer, author_of
from robot_offload_core.control.nodes.replica_parameters import MAX_NODES, MAX_STATED, Statement
from robot_offload_core.record.audit import parse_head
from robot_offload_core.words.parameters import MAX_NAME as MAX_PARAMETER_NAME

MAX_GENERATION = 2**53
MAX_NAME = 128
MAX_MESSAGE = 1024
MAX_REQUEST = 4096
"""Most characters of a request for a certificate. One has about 1,100."""
MAX_ANSWER = 16_384
SERIAL = re.compile(r"[0-9a-f]{0,40}")
TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ)?")
REASON = re.compile(r"[A-Za-z]{0,128}")
DIGEST = re.compile(r"[0-9a-f]{0,64}")
RELEASE = re.compile(r"[0-9A-Za-z.+!_-]{0,64}")
"""Characters of a version (PEP 440), limited to what a person reads."""
MAX_VETOES = 16


class NotesError(ValueError):
    """Text that is not valid notes."""


@dataclass(frozen=True)
class Credential:
    """The robot's certificate, as reported to the cloud.

    Attributes:
        serial: its serial number, hexadecimal; "" while it is not known.
        not_after: RFC 3339 time of its end.
        request: for a certificate of the robot's next key; "" for none.
        reason, message: why the robot cannot get another one; "" for no reason.
    """

    serial: str = ""
    not_after: str = ""
    request: str = ""
    reason: str = ""
    message: str = ""


@dataclass(frozen=True)
class CloudNotes:
    """From the cloud.

    Attributes:
        signs: certificates for robots are signed in this cluster.
        answer: to the robot's request for one; "" for none.
        offer: settings that the robot has not answered yet; None otherwise.
        leaving: names the end of pods that was announced last; "" for none.
        vetoes: (reason, message) of the cloud's findings that forbid it.
        parameters: the cloud's statements on its nodes' parameters, by node.
        release: of its agent, e.g. 0.1.0; "" if it is not known.
    """

    offer: Offer | None = None
    leaving: str = ""
    signs: bool = False
    answer: str = ""
    vetoes: tuple[tuple[str, str], ...] = ()
    parameters: dict[str, Statement] = field(default_factory=dict)
    release: str = ""


@dataclass(frozen=True)
class RobotNotes:
    """From the robot.

    Attributes:
        generation: of the settings that run.
        digest, accepted, reason, message: of the offer judged last, and the judgement; digest "" for none.
        left: `leaving` of the cloud that the robot has obeyed: from then on it does not choose this cloud.
        site, decided, decided_message: who is in charge, and why.
        credential: with which the robot dials.
        parameters: the robot's statements on its nodes' parameters, by node.
        dials: addresses (host:port) of the cloud that its bundle names, with spaces between them; "" if the agent dials
            none.
        audit: newest entry of its audit trail, NUMBER:DIGEST; "" if there is none.
    """

    generation: int = 0
    digest: str = ""
    accepted: bool = False
    reason: str = ""
    message: str = ""
    left: str = ""
    site: str = "robot"
    decided: str = ""
    decided_message: str = ""
    credential: Credential = field(default_factory=Credential)
    parameters: dict[str, Statement] = field(default_factory=dict)
    dials: str = ""
    audit: str = ""


def encode(notes: CloudNotes | RobotNotes) -> str:
    """Return the text of notes."""
    if isinstance(notes, RobotNotes):
        parts = {"credential": vars(notes.credential), "parameters": _stated(notes.parameters)}
        return json.dumps({**vars(notes), **parts}, separators=(",", ":"))
    offer = notes.offer
    body = {
        "leaving": notes.leaving,
        "offer": [offer.generation, dict(offer.parameters)] if offer else None,
        "author": offer.author if offer else "",
        "signs": notes.signs,
        "answer": notes.answer,
        "vetoes": notes.vetoes,
        "parameters": _stated(notes.parameters),
        "release": notes.release,
    }
    return json.dumps(body, separators=(",", ":"))


def decode_cloud(text: str) -> CloudNotes:
    """Read notes of the cloud; raise NotesError."""
    body = _table(text)
    leaving, offered = body.get("leaving"), body.get("offer")
    if not isinstance(leaving, str) or len(leaving) > MAX_NAME:
        raise NotesError("leaving is no name")
    signs, answer = body.get("signs") is True, body.get("answer", "")
    if not isinstance(answer, str) or len(answer) > MAX_ANSWER:
        raise NotesError("the answer is no text")
    rest = _vetoes(body.get("vetoes", [])), _statements(body.get("parameters", {})), _release(body.get("release"))
    if offered is None:
        return CloudNotes(None, leaving, signs, answer, *rest)
    if not isinstance(offered, list) or len(offered) != 2:
        raise NotesError("an offer is a generation and parameters")
    generation, parameters = offered
    if type(generation) is not int or not 0 <= generation <= MAX_GENERATION or not isinstance(parameters, dict):
        raise NotesError("an offer is a generation and parameters")
    return CloudNotes(Offer(generation, parameters, author_of(body.get("author"))), leaving, signs, answer, *rest)


def decode_robot(text: str) -> RobotNotes:
    """Read notes of the robot; raise NotesError. Fields that only a newer robot sends are ignored."""
    body = _table(text)
    known = {key: value for key, value in body.items() if key in RobotNotes.__dataclass_fields__}
    known["credential"] = _credential(known.get("credential"))
    known["parameters"] = _statements(known.get("parameters", {}))
    notes = RobotNotes(**known)
    plain = RobotNotes()
    for key, value in vars(notes).items():
        if type(value) is not type(getattr(plain, key)):
            raise NotesError(f"{key} has another type")
    if notes.site not in ("robot", "cloud"):
        raise NotesError("the site is robot or cloud")
    if not (0 <= notes.generation <= MAX_GENERATION and REASON.fullmatch(notes.reason + notes.decided)):
        raise NotesError("a generation or a reason has another form")
    if max(len(notes.digest), len(notes.left)) > MAX_NAME:
        raise NotesError("a name is too long")
    if notes.audit and parse_head(notes.audit) is None:
        raise NotesError("the head of the audit trail has another form")
    # Texts for people go on to the operator's status, which has its own limits.
    return replace(
        notes,
        message=notes.message[:MAX_MESSAGE],
        decided_message=notes.decided_message[:MAX_MESSAGE],
        dials=notes.dials[:MAX_MESSAGE],
    )


def _credential(value: object) -> Credential:
    """Return the robot's report of its certificate; an empty one if a part has another form."""
    told = {key: value.get(key, "") for key in vars(Credential())} if isinstance(value, dict) else {}
    if not all(isinstance(text, str) for text in told.values()):
        return Credential()
    found = Credential(**told)
    fine = SERIAL.fullmatch(found.serial) and TIME.fullmatch(found.not_after) and REASON.fullmatch(found.reason)
    if not fine or len(found.request) > MAX_REQUEST:
        return Credential()
    return replace(found, message=found.message[:MAX_MESSAGE])


def _stated(parameters: dict[str, Statement]) -> dict[str, list[object]]:
    return {node: [said.digest, said.has, said.table] for node, said in parameters.items()}


def _statements(value: object) -> dict[str, Statement]:
    """Return the other side's statements on its nodes' parameters; raise NotesError."""
    if not isinstance(value, dict) or len(value) > MAX_NODES:
        raise NotesError(f"the parameters are no table of up to {MAX_NODES} nodes")
    found = {}
    for node, said in value.items():
        if len(node) > MAX_PARAMETER_NAME or not isinstance(said, list) or len(said) != 3:
            raise NotesError("parameters of a node are two digests and a table")
        digest, has, table = said
        if not _is_digest(digest) or not _is_digest(has) or not (table is None or _is_table(table)):
            raise NotesError("a digest has another form")
        found[node] = Statement(digest, has, table)
    return found


def _is_digest(value: object) -> bool:
    return isinstance(value, str) and DIGEST.fullmatch(value) is not None


def _is_table(value: object) -> bool:
    return (
        isinstance(value, dict)
        and len(value) <= MAX_STATED
        and all(len(name) <= MAX_PARAMETER_NAME and _is_digest(digest) for name, digest in value.items())
    )


def _release(value: object) -> str:
    """Return the release that the cloud reports; "" for anything else."""
    return value if isinstance(value, str) and RELEASE.fullmatch(value) else ""


def _vetoes(value: object) -> tuple[tuple[str, str], ...]:
    """Return the cloud's findings that forbid it; raise NotesError."""
    if not isinstance(value, list) or len(value) > MAX_VETOES:
        raise NotesError(f"the vetoes are no list of up to {MAX_VETOES}")
    found = []
    for veto in value:
        if not isinstance(veto, list) or len(veto) != 2 or not all(isinstance(text, str) for text in veto):
            raise NotesError("a veto is a reason and a message")
        found.append((veto[0][:MAX_NAME], veto[1][:MAX_MESSAGE]))
    return tuple(found)


def _table(text: str) -> dict[str, Any]:
    try:
        body = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise NotesError(f"no JSON: {error}") from error
    if not isinstance(body, dict):
        raise NotesError("no table")
    return body
