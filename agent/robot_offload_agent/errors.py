"""Errors of the agent; each message says what to do next."""

from __future__ import annotations


class AgentError(Exception):
    """Base. `exit_code` is what the process ends with."""

    exit_code = 1


class ConfigurationError(AgentError):
    """A parameter that cannot work; names the parameter."""

    exit_code = 2


class AlreadyRunningError(AgentError):
    """Another agent of this identity runs on this host."""

    exit_code = 3


class StartError(AgentError):
    """Something in the ROS graph forbids the start, e.g. a second publisher or a missing type."""

    exit_code = 4
