"""Stories of two sides that do not say the same: other lists, another version, and what a copy of the key hears."""

from __future__ import annotations

from typing import Any

from robot_offload_core.data.process import InputPlan
from robot_offload_core.fence import envelope
from robot_offload_core.fence.token import Site
from robot_offload_core.words import beats
from robot_offload_core.words.beats import PREVIOUS, VERSION, Beat, CloudReport
from robot_offload_core.words.decided import Phase
from robot_offload_core.words.replace import replace
from robot_offload_sim.stories.stage import Stage

SCAN, MAP = InputPlan("scan", 100), InputPlan("map", 2000)


def lists_in_another_order() -> None:
    """Inputs in another order on the two sides are a hard limit: ages go by place."""
    stage = Stage(inputs=(SCAN, MAP), cloud_inputs=(MAP, SCAN), input_periods_s=(0.05, 0.5))
    stage.start()
    stage.until(lambda: stage.machine.decided.reason == "ConfigurationDiffers", 3.0, "the other order is noticed")
    stage.always(lambda: stage.site is Site.ROBOT, 2.0, "the robot acts")
    stage.expect(not stage.by_hand(Site.CLOUD), "and the cloud cannot be had by hand")


def types_that_differ() -> None:
    """An input that the cloud publishes under another type is a hard limit, and none of its messages is published."""
    stage = Stage(inputs=(SCAN, MAP), input_periods_s=(0.05, 0.5))
    stage.in_cloud()
    stage.cloud.data.input_types["map"] = "simulated/msg/Other"
    heard: list[str] = []
    publish = stage.cloud.data.publish_input

    def keep(name: str, payload: Any) -> bool:
        heard.append(name)
        return publish(name, payload)

    stage.cloud.data.publish_input = keep  # type: ignore[method-assign]
    stage.until(lambda: stage.machine.decided.reason == "TypesDiffer", 3.0, "the other type is a limit")
    stage.until(lambda: stage.site is Site.ROBOT, 1.0, "the robot acts")
    stage.expect("scan" in heard, "what has the same type is published")
    stage.expect("map" not in heard, "bytes of another type are not")


def the_robots_name_stays_with_the_robot() -> None:
    """Nothing that the cloud says holds the robot's incarnation, with which a copy of the key could speak as it."""
    stage = Stage()
    said: list[str] = []

    def text(beat: Beat | str) -> str:
        return beat if isinstance(beat, str) else beats.encode(beat)

    _listen(stage.link.pulse.down, lambda beat, _at_s: said.append(text(beat)))
    _listen(stage.link.data.down, lambda _channel, header, payload: said.append(f"{header.hex()} {_plain(payload)}"))
    stage.in_cloud()
    stage.run(1.0)
    name = stage.machine.incarnation
    stage.expect(len(said) > 100, "the cloud speaks")
    stage.expect(not any(name in one for one in said), "the cloud does not say the robot's incarnation")


def older_robot() -> None:
    """A cloud that was upgraded first serves a robot of the version before: it speaks as that does."""
    stage = Stage()
    answered: list[str] = []

    def up(sent: Beat | str, *rest: Any) -> tuple[Any, ...]:
        return (replace(_beat(sent), version=PREVIOUS), *rest)

    def down(sent: Beat | str, *rest: Any) -> tuple[Any, ...] | None:
        beat = _beat(sent)
        answered.append(beat.version)
        known = beat.version == PREVIOUS and (beat.echo is None or beat.echo.incarnation == stage.machine.incarnation)
        return (beats.encode(beat), *rest) if known else None  # what it does not know it leaves out

    def passed(channel: str, header: bytes, payload: Any) -> tuple[Any, ...] | None:
        carried = len(header) == envelope.LAYOUT.size
        if carried and envelope.decode(header).token.robot != stage.machine.incarnation:
            return None
        return channel, header, payload

    _translate(stage.link.pulse.up, up)
    _translate(stage.link.pulse.down, down)
    _translate(stage.link.data.down, passed)
    stage.in_cloud()
    stage.always(lambda: stage.site is Site.CLOUD, 2.0, "the older robot keeps its cloud")
    stage.expect(answered[-1] == PREVIOUS, "the cloud speaks as the robot does")


def older_cloud() -> None:
    """A robot that was upgraded first is served by a cloud of the version before: it speaks as that does."""
    stage = Stage()
    heard: list[str] = []

    def up(sent: Beat | str, *rest: Any) -> tuple[Any, ...] | None:
        beat = _beat(sent)
        heard.append(beat.version)
        return (sent, *rest) if beat.version == PREVIOUS else None

    def down(sent: Beat | str, *rest: Any) -> tuple[Any, ...]:
        beat = replace(beats.unveil(_beat(sent), stage.machine.incarnation), version=PREVIOUS)
        if isinstance(beat.body, CloudReport):
            beat = replace(beat, body=replace(beat.body, shape=""))
        return (beat, *rest)

    _translate(stage.link.pulse.up, up)
    _translate(stage.link.pulse.down, down)
    stage.in_cloud()
    stage.always(lambda: stage.phase is Phase.CLOUD, 2.0, "the older cloud goes on")
    stage.expect(heard[0] == VERSION and heard[-1] == PREVIOUS, "the robot speaks as the cloud does")


def _beat(sent: Beat | str) -> Beat:
    return beats.decode(sent) if isinstance(sent, str) else sent


def _plain(payload: Any) -> str:
    return payload.decode(errors="replace") if isinstance(payload, bytes) else ""


def _listen(wire: Any, hear: Any) -> None:
    """Call `hear` with everything that goes through a wire."""
    _translate(wire, lambda *args: (hear(*args), args)[1])


def _translate(wire: Any, say: Any) -> None:
    """Let a wire carry the result of `say` for what is sent; None: nothing."""
    carry = wire.carry

    def carried(*args: Any, **how: Any) -> None:
        said = say(*args)
        if said is not None:
            carry(*said, **how)

    wire.carry = carried


STORIES = (lists_in_another_order, types_that_differ, the_robots_name_stays_with_the_robot, older_robot, older_cloud)
