"""Errors of the agent; each message states the next step."""

from __future__ import annotations


class AgentError(Exception):
    """Base class. `exit_code` is the exit code of the process."""

    exit_code = 1


class ConfigurationError(AgentError):
    """Invalid parameter; the message names it."""

    exit_code = 2


class AlreadyRunningError(AgentError):
    """Another agent of this identity runs on this host."""

    exit_code = 3


class StartError(AgentError):
    """Something in the ROS graph forbids the start, e.g. a second publisher or a missing type."""

    exit_code = 4
