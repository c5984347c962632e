"""What the two control processes tell each other besides beats: settings and their answer, and a cloud that leaves.

Notes travel as text in the probes of the data session, ten times a second on every kind of link. They are levels: each
says all that holds now, so a lost one loses nothing. Pure.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field, replace
from typing import Any

from robot_offload_agent.settings.offer import Offer

MAX_GENERATION = 2**53
MAX_NAME = 128
MAX_MESSAGE = 1024
MAX_REQUEST = 4096
"""Characters of a request for a certificate. One has about 1,100."""
MAX_ANSWER = 16_384
SERIAL = re.compile(r"[0-9a-f]{0,40}")
TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ)?")
REASON = re.compile(r"[A-Za-z]{0,128}")


class NotesError(ValueError):
    """Text that is no notes of ours."""


@dataclass(frozen=True)
class Credential:
    """The robot's certificate, as the cloud is to know it.

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
    """

    offer: Offer | None = None
    leaving: str = ""
    signs: bool = False
    answer: str = ""


@dataclass(frozen=True)
class RobotNotes:
    """From the robot.

    Attributes:
        generation: of the settings that run.
        digest, accepted, reason, message: of the offer judged last, and the judgement; digest "" for none.
        left: `leaving` of the cloud that the robot has obeyed: from then on it does not choose this cloud.
        site, decided, decided_message: who is in charge, and why.
        credential: with which the robot dials.
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


def encode(notes: CloudNotes | RobotNotes) -> str:
    """The text of notes."""
    if isinstance(notes, RobotNotes):
        return json.dumps({**vars(notes), "credential": vars(notes.credential)}, separators=(",", ":"))
    offer = notes.offer
    body = {
        "leaving": notes.leaving,
        "offer": [offer.generation, dict(offer.parameters)] if offer else None,
        "signs": notes.signs,
        "answer": notes.answer,
    }
    return json.dumps(body, separators=(",", ":"))


def decode_cloud(text: str) -> CloudNotes:
    """Notes of the cloud; raises NotesError."""
    body = _table(text)
    leaving, offered = body.get("leaving"), body.get("offer")
    if not isinstance(leaving, str) or len(leaving) > MAX_NAME:
        raise NotesError("leaving is no name")
    signs, answer = body.get("signs") is True, body.get("answer", "")
    if not isinstance(answer, str) or len(answer) > MAX_ANSWER:
        raise NotesError("the answer is no text")
    if offered is None:
        return CloudNotes(None, leaving, signs, answer)
    if not isinstance(offered, list) or len(offered) != 2:
        raise NotesError("an offer is a generation and parameters")
    generation, parameters = offered
    if type(generation) is not int or not 0 <= generation <= MAX_GENERATION or not isinstance(parameters, dict):
        raise NotesError("an offer is a generation and parameters")
    return CloudNotes(Offer(generation, parameters), leaving, signs, answer)


def decode_robot(text: str) -> RobotNotes:
    """Notes of the robot; raises NotesError. What a newer robot says besides is left out."""
    body = _table(text)
    known = {key: value for key, value in body.items() if key in RobotNotes.__dataclass_fields__}
    known["credential"] = _credential(known.get("credential"))
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
    # Texts for people go on to the operator's status, which has limits of its own.
    return replace(notes, message=notes.message[:MAX_MESSAGE], decided_message=notes.decided_message[:MAX_MESSAGE])


def _credential(value: object) -> Credential:
    """What the robot says of its certificate; nothing of it when a part has another form."""
    told = {key: value.get(key, "") for key in vars(Credential())} if isinstance(value, dict) else {}
    if not all(isinstance(text, str) for text in told.values()):
        return Credential()
    found = Credential(**told)
    fine = SERIAL.fullmatch(found.serial) and TIME.fullmatch(found.not_after) and REASON.fullmatch(found.reason)
    if not fine or len(found.request) > MAX_REQUEST:
        return Credential()
    return replace(found, message=found.message[:MAX_MESSAGE])


def _table(text: str) -> dict[str, Any]:
    try:
        body = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise NotesError(f"no JSON: {error}") from error
    if not isinstance(body, dict):
        raise NotesError("no table")
    return body
