"""The robot's settings while it runs: the cloud's offer is judged, stored and then adopted."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from robot_offload_agent.settings import store
from robot_offload_agent.settings.notes import (
    MAX_MESSAGE,
    CloudNotes,
    Credential,
    NotesError,
    RobotNotes,
    decode_cloud,
    encode,
)
from robot_offload_agent.settings.offer import Answer, Judgement, Offer, input_limits, judge
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.control.nodes.replica_parameters import Statement
from robot_offload_core.fence.token import Site
from robot_offload_core.words.messages import Limits

log = logging.getLogger(__name__)

UNKNOWN = Credential()


class RobotSettings:
    """Runs on the deciding thread; only writing to the disk happens on another one.

    Attributes:
        local: the robot's file, with the hard limits.
        present: the settings in force.
        problem: (reason, message) for diagnostics; None if there is none.
        heard: the newest notes of the cloud.
    """

    def __init__(
        self, local: Configuration, post: Callable[[Callable[[float], None]], None], adopt: Callable[[float], None]
    ) -> None:
        """`adopt` is called when an offer was answered; `present` has changed if it was accepted."""
        self.local = local
        self.post = post
        self.adopt = adopt
        self.keeping = False
        self.disk = threading.Lock()
        self.heard = CloudNotes()
        self.present, offer, self.problem = store.load(local)
        self.judged = offer.digest if offer is not None else ""
        self.judgement = Judgement(self.present, Answer.ACCEPTED, f"The robot runs generation {self.generation}")
        if self.problem is not None:
            log.warning("%s reason=%s", self.problem[1], self.problem[0])
        elif offer is not None:
            log.info("Settings kept from an earlier run are in force generation=%d", offer.generation)

    @property
    def generation(self) -> int:
        """Generation of the settings in force."""
        return int(self.present["generation"])

    @property
    def dials(self) -> str:
        """The addresses that the bundle names, with spaces between them; "" if the agent itself does not dial."""
        found = dict.fromkeys((*self.local["link.pulse_endpoints"], *self.local["link.data_endpoints"]))
        return " ".join(each.partition("/")[2] for each in found if "/" in each)[:MAX_MESSAGE]

    def limits(self) -> Limits:
        """Return the limits for the other processes."""
        settings = self.present.settings()
        return Limits(
            settings.max_command_age_s, settings.lease_s, input_limits(self.present),
            settings.loss_timeout_s, settings.activation_deadline_s,
        )  # fmt: skip

    def take(self, text: str) -> str:
        """Take the cloud's notes; return its announced end (`leaving`)."""
        try:
            notes = decode_cloud(text)
        except NotesError as error:
            log.warning("Notes of the cloud that are none of ours: %s", error)
            return ""
        self.heard = notes
        offer = notes.offer
        again = self.judgement.reason is Answer.NOT_KEPT and not self.keeping  # the disk may have been freed
        if offer is not None and (offer.digest != self.judged or again):
            again, self.judged = offer.digest == self.judged, offer.digest
            judgement = judge(self.local, self.generation, offer)
            if judgement.configuration is None:
                self.post(lambda now: self._kept(offer, judgement, now))
            else:
                # Nothing is answered until it is on the disk: what was accepted must hold at an offline start.
                self.keeping = True
                if not again:
                    self.judgement = Judgement(None, Answer.KEEPING, "The robot writes the settings to its disk")
                threading.Thread(target=self._keep, args=(offer, judgement), name="keep", daemon=True).start()
        return notes.leaving

    def notes(
        self, left: str, site: Site, reason: str, message: str, credential: Credential = UNKNOWN,
        parameters: dict[str, Statement] | None = None, audit: str = "",
    ) -> str:  # fmt: skip
        """Return the notes for the cloud."""
        judgement = self.judgement
        digest = "" if judgement.reason is Answer.KEEPING else self.judged
        accepted = judgement.configuration is not None
        told = RobotNotes(
            self.generation, digest, accepted, judgement.reason, judgement.message, left, site.value, reason, message,
            credential, parameters or {}, self.dials, audit,
        )  # fmt: skip
        return encode(told)

    def _keep(self, offer: Offer, judgement: Judgement) -> None:
        try:
            with self.disk:
                if offer.digest == self.judged:  # else a newer one is written before or after us, and stays
                    store.keep(self.local, offer)
        except OSError as error:
            message = f"{store.path(self.local)} cannot be written: {error.strerror}; free the disk, or set state_dir"
            judgement = Judgement(None, Answer.NOT_KEPT, message)
        self.post(lambda now: self._kept(offer, judgement, now))

    def _kept(self, offer: Offer, judgement: Judgement, now: float) -> None:
        if offer.digest != self.judged:
            return  # a newer one was offered meanwhile
        self.keeping = False
        self.judgement = judgement
        if judgement.configuration is None:
            message = f"Settings of the cloud were refused ({judgement.reason}): {judgement.message}"
            self.problem = ("SettingsRefused", message)
        else:
            self.problem = None
            self.present = judgement.configuration
            log.info("%s reason=Accepted", judgement.message)
        self.adopt(now)
