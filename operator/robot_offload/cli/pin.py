"""`robot-offload pin`: hold a robot's application on one side, or let go."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from robot_offload.cli.app import example_text
from robot_offload.cli.cluster import Context, Kubeconfig, Name, Namespace, Target, find
from robot_offload.insight.observed import Observed, observe
from robot_offload.kube.kinds import ROBOT_OFFLOAD
from robot_offload.kube.port import KubeApi

EXAMPLES = (
    "robot-offload pin wheelchair-7 robot",
    "kubectl offload pin wheelchair-7 auto -n ward",
)


class Side(StrEnum):
    """Where to hold it."""

    ROBOT = "robot"
    CLOUD = "cloud"
    AUTO = "auto"


def add_to(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("pin", epilog=example_text(EXAMPLES))(pin)


def pin(
    name: Name,
    side: Annotated[Side, typer.Argument(metavar="robot|cloud|auto", help="auto: let the policy decide.")],
    *,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Hold the application on one side, or let go.

    It changes spec.switching.pin. A connected robot hears it at once, any other when it connects. Safety stays above
    it: a lost robot acts alone, whatever is pinned. A pin in your own YAML file counts again at the next apply.
    """
    wanted = side.value.capitalize()
    target = Target(kubeconfig, context, namespace)
    place = target.namespace

    async def work(api: KubeApi) -> tuple[Observed, Observed]:
        before = await find(api, place, name)
        body = {
            # Another object of this name, or one that was changed meanwhile, is not ours to pin.
            "metadata": {"uid": before["metadata"]["uid"]},
            "spec": {"switching": {"pin": wanted}},
        }
        return observe(before), observe(await api.patch(ROBOT_OFFLOAD, place, name, body))

    for line in told(*target.run(work)):
        typer.echo(line)


def told(before: Observed, after: Observed) -> list[str]:
    """What to say after the change."""
    if before.pin == after.pin:
        return [f"{after.name}: the pin is {after.pin} already; nothing was changed"]
    meaning = "the policy decides again" if after.pin == "Auto" else f"held on the {after.pin.lower()}"
    lines = [f"{after.name}: {meaning} (the pin was {before.pin}); generation {after.generation}"]
    if not before.connected:
        lines.append("The robot is not connected; it gets this when it connects.")
    elif after.pin == "Cloud" and not before.ready:
        lines.append(f"The cloud side is not ready yet; see: kubectl offload explain {after.name}")
    if after.mode == "Observe":
        lines.append("spec.switching.mode is Observe: it decides and says so, but never switches.")
    return lines
