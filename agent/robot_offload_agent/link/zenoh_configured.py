"""The settings of the two Zenoh sessions from the agent's configuration; needs neither ROS nor the wheel."""

from __future__ import annotations

from robot_offload_agent.link.zenoh_config import ZenohSettings
from robot_offload_agent.settings.parameters import Configuration, listed

SESSION_LEASE_MS = {"pulse": 500, "data": 1000}
"""Facts of the wheel: with shorter ones the session flaps at 5 % loss, longer ones let stale samples live on."""


def zenoh_settings(configuration: Configuration, session: str) -> ZenohSettings:
    """Return the settings of one of the two Zenoh sessions."""
    return ZenohSettings(
        side=configuration["side"],
        session=session,
        uid=configuration["uid"],
        endpoints=tuple(listed(configuration[f"link.{session}_endpoints"])),
        fallback=tuple(listed(configuration[f"link.{session}_fallback"])),
        ca=configuration["link.ca"],
        certificate=configuration["link.certificate"],
        private_key=configuration["link.private_key"],
        peer_name=configuration["link.peer_name"],
        verify_name=configuration["link.verify_name"],
        observers=tuple(listed(configuration["link.observers"])),
        lease_ms=SESSION_LEASE_MS[session],
        fallback_after_ms=round(configuration["link.fallback_after_ms"]),
    )
