"""The robot's certificate while it runs: the state of `renewal`, and threads that carry out its commands."""

from __future__ import annotations

import datetime
import logging
import threading
import time
from collections.abc import Callable

from robot_offload_agent.certificates import renewal
from robot_offload_agent.certificates.openssl import CertificateError
from robot_offload_agent.certificates.wallet import Wallet, renews
from robot_offload_agent.settings.notes import Credential
from robot_offload_agent.settings.parameters import Configuration
from robot_offload_core.words.problems import Problem

log = logging.getLogger(__name__)


class CertificateKeeper:
    """Runs on the deciding thread; disk and `openssl` have threads of their own.

    Attributes:
        credential: what the cloud needs to know.
        problem: (reason, message) for diagnostics; None if there is none.
    """

    def __init__(
        self, configuration: Configuration, post: Callable[[Callable[[float], None]], None], changed: Callable[[], None]
    ) -> None:
        """`post` hands work to the deciding thread; `changed` is called there when there is news for the cloud."""
        self._post = post
        self._changed = changed
        self._wallet = Wallet(configuration)
        self._state = renewal.Renewal()
        self.credential = Credential()
        self.problem: tuple[str, str] | None = None
        self._active = renews(configuration)
        if self._active:
            self._aside(self._look)

    def hear(self, signs: bool, answer: str, now: float) -> None:
        """Take the cloud's notes about certificates."""
        if self._active:
            self._take(renewal.Heard(signs, answer), now)

    def _take(self, event: renewal.Event, now: float) -> None:
        self._state, command = renewal.step(self._state, event, now, time.clock_gettime(time.CLOCK_REALTIME))
        match command:
            case renewal.MakeRequest():
                log.info("Asking for a certificate for a key of this robot's own")
                self._aside(lambda: renewal.Asking(self._wallet.request()))
            case renewal.Keep(pem):
                self._aside(lambda: self._keep(pem))
            case renewal.Drop():
                log.warning("The cluster signs no certificate: %s reason=%s", self._state.message, self._state.reason)
                threading.Thread(target=self._wallet.drop, name="certificate", daemon=True).start()
        self._show()

    def _show(self) -> None:
        state, found = self._state, self._state.certificate
        self.problem = (Problem.CERTIFICATE_NOT_RENEWED, f"{state.message} ({state.reason})") if state.reason else None
        if found is not None:
            end = datetime.datetime.fromtimestamp(found.end_s, datetime.timezone.utc)
            shown = Credential(found.serial, f"{end:%Y-%m-%dT%H:%M:%SZ}", state.request, state.reason, state.message)
            if shown != self.credential:
                self.credential = shown
                self._changed()

    def _look(self) -> renewal.Event:
        return renewal.Found(*self._wallet.present())

    def _keep(self, pem: str) -> renewal.Event:
        found = self._wallet.keep(pem)
        log.info("Took a certificate for this robot's own key, for the next connection serial=%s", found.serial)
        return renewal.Found(found, bundled=False)

    def _aside(self, work: Callable[[], renewal.Event]) -> None:
        """Do work on its own thread; its result is an event on the deciding thread."""

        def run() -> None:
            try:
                event = work()
            except (CertificateError, OSError) as error:
                log.warning("The robot's certificate is not renewed: %s", error)
                event = renewal.Failed(str(error))
            self._post(lambda now: self._take(event, now))

        threading.Thread(target=run, name="certificate", daemon=True).start()
