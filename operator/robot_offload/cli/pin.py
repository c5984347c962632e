"""`robot-offload pin`: hold a robot's application on one side, or let go."""

from __future__ import annotations

import datetime
from enum import StrEnum
from typing import Annotated, Final

import typer

from robot_offload.api.v1alpha1 import pinned
from robot_offload.api.v1alpha1.quantities import parse_duration
from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import Context, Kubeconfig, Name, Namespace, Target, find
from robot_offload.errors import InputError
from robot_offload.insight.observed import Observed, observe
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi

EXAMPLES = (
    "robot-offload pin wheelchair-7 robot",
    "kubectl offload pin wheelchair-7 cloud --for 10m",
    "kubectl offload pin wheelchair-7 auto -n ward",
)
LONGEST_MS: Final = 30 * 24 * 3_600_000
"""Longest pin with an end: thirty days. For longer, pin without an end."""


class Side(StrEnum):
    """The side to pin to."""

    ROBOT = "robot"
    CLOUD = "cloud"
    AUTO = "auto"


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("pin", epilog=example_text(EXAMPLES))(pin)


def pin(
    name: Name,
    side: Annotated[Side, typer.Argument(metavar="robot|cloud|auto", help="auto: let the policy decide.")],
    *,
    lasting: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="DURATION",
            help="How long the pin holds, from 1s to 720h, e.g. 10m. Default: until it is taken back.",
        ),
    ] = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Hold the application on one side, or let go.

    It changes spec.switching.pin, and with --for the annotation robotoffload.dev/pinned-until. A connected robot hears
    it at once, any other when it connects. Safety stays above
    it: a lost robot acts alone, whatever is pinned. A pin in your own YAML file counts again at the next apply.
    """
    wanted = side.value.capitalize()
    until = end(wanted, lasting, datetime.datetime.now(datetime.UTC))
    target = Target(kubeconfig, context, namespace)
    place = target.namespace

    async def work(api: KubeApi) -> tuple[Observed, Observed]:
        before = await find(api, place, name)
        body = {
            # Another object of this name, or one that was changed meanwhile, must not be pinned.
            "metadata": {"uid": before["metadata"]["uid"], "annotations": {pinned.PINNED_UNTIL: until}},
            "spec": {"switching": {"pin": wanted}},
        }
        return observe(before), observe(await api.patch(ROBOT_OFFLOAD, place, name, body))

    for line in told(*target.run(work)):
        typer.echo(line)


def end(side: str, lasting: str | None, now: datetime.datetime) -> str | None:
    """Return the annotation's text for a pin; None: the pin has no end.

    Args:
        side: Auto, Robot or Cloud.
        lasting: how long it holds, as given; None: until it is removed.
        now: the present.

    Raises:
        InputError: `lasting` is not a duration.
    """
    if lasting is None:
        return None
    if side == pinned.AUTO:
        raise InputError("--for: only a pin to a side has an end; leave it out with auto")
    try:
        lasts_ms = parse_duration(lasting)
    except ValueError as error:
        raise InputError(f"--for: {error}") from None
    if not 1000 <= lasts_ms <= LONGEST_MS:
        raise InputError(f"--for: {lasting} is not from 1s to 720h")
    return pinned.written(side, now + datetime.timedelta(milliseconds=lasts_ms))


def told(before: Observed, after: Observed) -> list[str]:
    """Return the message after the change."""
    if (before.pin, before.pinned_until) == (after.pin, after.pinned_until):
        return [f"{after.name}: the pin is {after.pin} already; nothing was changed"]
    meaning = "the policy decides again" if after.pin == "Auto" else f"held on the {after.pin.lower()}{_until(after)}"
    lines = [f"{after.name}: {meaning} (the pin was {before.pin}); generation {after.generation}"]
    if not before.connected:
        lines.append("The robot is not connected; it gets this when it connects.")
    elif after.pin == "Cloud" and not before.ready:
        lines.append(f"The cloud side is not ready yet; see: kubectl offload explain {after.name}")
    if after.mode == "Observe":
        lines.append("spec.switching.mode is Observe: it decides and says so, but never switches.")
    return lines


def _until(offload: Observed) -> str:
    return f" until {offload.pinned_until}" if offload.pinned_until else ""
