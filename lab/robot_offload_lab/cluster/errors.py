"""What can go wrong with the test cluster."""

from __future__ import annotations


class ClusterError(Exception):
    """The test cluster cannot do what was asked; the message states why and what to do next."""


class NoGoError(ClusterError):
    """The programs are not built yet and there is no Go to build them with."""


class CommandError(ClusterError):
    """A kubectl or helm command ended differently than the test expects."""


class NotHereError(ClusterError):
    """This kind of cluster cannot do it, though another one can; the message states why."""
