"""`robot-offload demo`: one RobotOffload on this machine, with a link that fails as its options say."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from robot_offload.cli.app import example_text
from robot_offload.errors import InputError
from robot_offload_lab.cli.pages import ConsolePages
from robot_offload_lab.judge import recording
from robot_offload_lab.run import routed
from robot_offload_lab.run.demo import LONGEST_S, DemoOptions, DemoResult, run
from robot_offload_lab.run.free import parse_domains
from robot_offload_lab.run.realtime import is_permitted
from robot_offload_lab.run.system import Mode
from robot_offload_lab.show.summary import summary
from robot_offload_lab.show.view import LineView, LiveView, Terminal, View
from robot_offload_lab.wire.options import LinkOptions

EXAMPLES = (
    "robot-offload demo",
    "robot-offload demo --mode cloud-only",
    "robot-offload demo --example sedia --compare",
    "robot-offload demo --outage 4/20 --slow 3/31@120ms --delay 5ms --jitter 2ms --loss 1%",
    "robot-offload demo --trace examples/traces/yard-4g.csv --duration 40",
    "robot-offload demo examples/talker/robotoffload.yaml --duration 12 --outage 2/6 --no-ui --json",
)
DEFAULT_EXAMPLE = "wheelchair"
FILE = "robotoffload.yaml"
COMPARED_S = 120.0
"""LONGEST_S with --compare: a run with only one side takes longer."""
DEFAULT_DELAY = "5ms"
DEFAULT_JITTER = "2ms"
DEFAULT_LOSS = "1%"
DEFAULT_OUTAGE = "4/20"
DEFAULT_SLOW = "3/31@120ms"
NONE = "none"


class LinkOption(StrEnum):
    """The values of `--link`."""

    ZENOH = "zenoh"
    ROS = "ros"
    ROUTER = "router"


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("demo", epilog=example_text(EXAMPLES))(demo)


def _transport(link: LinkOption | None) -> str:
    """Return the transport type that a value of `--link` means; empty: the specification's."""
    if link is LinkOption.ROUTER and not routed.binary():
        raise InputError(f"--link router: set {routed.VARIABLE} to the path of a DDS Router 3.4.0")
    return {
        None: "", LinkOption.ZENOH: "Zenoh", LinkOption.ROS: "StaticPeers", LinkOption.ROUTER: "DDSRouter",
    }[link]  # fmt: skip


def _option(name: str, metavar: str, text: str) -> Any:
    """Return an option with a value; its default stands in the signature."""
    return typer.Option(f"--{name}", metavar=metavar, help=text)


Spec = Annotated[
    Path | None,
    typer.Argument(metavar="SPEC", help="YAML file with one RobotOffload. Default: the wheelchair example."),
]
Example = Annotated[
    str,
    _option("example", "NAME", "Example of the repository instead of SPEC: wheelchair, sedia or talker."),
]
Modes = Annotated[
    Mode, typer.Option(help="offload: both sides; robot-only: no cloud; cloud-only: no replicas on the robot.")
]
Duration = Annotated[
    float | None,
    _option("duration", "SECONDS", "Seconds to run. Default: until the goal, at most 75; 120 with --compare."),
]
Outages = Annotated[
    list[str] | None,
    _option(
        "outage",
        "LENGTH/PERIOD",
        "Both directions cut for LENGTH of every PERIOD seconds; more than once, or none. Default: 4/20, with --trace "
        "none.",
    ),
]
SlowPhases = Annotated[
    list[str] | None,
    _option(
        "slow",
        "LENGTH/PERIOD@TIME",
        "TIME more round trip for LENGTH of every PERIOD seconds; more than once, or none. Default: 3/31@120ms, with "
        "--trace none.",
    ),
]
Delay = Annotated[str, _option("delay", "TIME", "One-way delay, or UP/DOWN. Default: 5ms, with --trace 0ms.")]
Jitter = Annotated[str, _option("jitter", "TIME", "Standard deviation of the delay. Default: 2ms, with --trace 0ms.")]
Loss = Annotated[str, _option("loss", "SHARE", "Share of packets lost each way. Default: 1%, with --trace 0%.")]
Rate = Annotated[str, _option("rate", "RATE", "Rate of the link, for example 20mbit. Default: unlimited.")]
TraceFile = Annotated[str, _option("trace", "FILE", "File of recorded round-trip times to replay.")]
Seed = Annotated[int, typer.Option(help="Random seed of the link's chances and of the world.")]
Out = Annotated[Path, _option("out", "DIR", "Folder for report, recording and logs.")]
Joined = Annotated[
    LinkOption | None, typer.Option(help="How the agents are joined. Default: as the specification says.")
]
Domains = Annotated[str, _option("domains", "ROBOT/CLOUD", "ROS domains of the two sides. Default: free ones.")]
Compared = Annotated[
    bool,
    typer.Option(
        "--compare",
        help="Run all three modes, one after the other, and draw them in one picture; judge the one with both sides.",
    ),
]
Picture = Annotated[bool, typer.Option("--ui/--no-ui", help="Show a live picture, or print one line per event.")]
Pages = Annotated[bool, typer.Option("--console", help="Show the run in the browser as well, until Ctrl-C.")]
Port = Annotated[int, _option("port", "PORT", "Port of --console on 127.0.0.1. Default: a free one.")]
Realtime = Annotated[
    bool | None,
    typer.Option(
        "--realtime/--normal", help="Priority of agents and nodes. Default: real-time where that is permitted."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print report.json on standard output at the end.")]


def demo(
    spec: Spec = None,
    *,
    example: Example = "",
    mode: Modes = Mode.OFFLOAD,
    duration: Duration = None,
    outage: Outages = None,
    slow: SlowPhases = None,
    delay: Delay = "",
    jitter: Jitter = "",
    loss: Loss = "",
    rate: Rate = "",
    trace: TraceFile = "",
    seed: Seed = 1,
    out: Out = Path("out/demo"),
    link: Joined = None,
    domains: Domains = "",
    compare: Compared = False,
    ui: Picture = True,
    console: Pages = False,
    port: Port = 0,
    realtime: Realtime = None,
    as_json: AsJson = False,
) -> None:
    """Run both sides on this machine while the link between them fails, and report what the consumers felt.

    Writes report.html, report.json, run.png, run.mcap, the recording and all logs into a folder. Ends with 0 when every
    promise was kept, with 1 when one was broken or a process died, and with 2 when the input is wrong.
    """
    options = DemoOptions(
        spec=_found(spec, example),
        mode=mode,
        duration_s=_duration_s(duration),
        longest_s=COMPARED_S if compare else LONGEST_S,
        link=LinkOptions(
            delay=delay or ("0ms" if trace else DEFAULT_DELAY),
            jitter=jitter or ("0ms" if trace else DEFAULT_JITTER),
            loss=loss or ("0%" if trace else DEFAULT_LOSS),
            rate=rate,
            outages=_phases(outage, "" if trace else DEFAULT_OUTAGE),
            slow=_phases(slow, "" if trace else DEFAULT_SLOW),
            trace=str(Path(trace).resolve()) if trace else "",
        ),
        seed=seed,
        out=out,
        realtime=is_permitted() if realtime is None else realtime,
        transport=_transport(link),
        domains=parse_domains(domains),
    )
    # Standard output carries only the report, so that a program can read it.
    terminal = Terminal(stderr=as_json)
    if console and compare:
        raise InputError("--console, --compare: one of them at a time")
    pages = ConsolePages(port) if console else None
    options = replace(options, seen=pages.show) if pages else options
    if compare:
        results = {it.value: _run(replace(options, mode=it, out=out / it.value), terminal, ui) for it in Mode}
        _compare(results, out, terminal)
    else:
        results = {mode.value: _run(options, terminal, ui)}
    if as_json:
        reports = {name: result.report for name, result in results.items()}
        typer.echo(json.dumps(reports if compare else reports[mode.value], indent=2))
    if pages is not None:
        pages.linger(terminal)
    # One side alone breaks promises, which is what the comparison shows.
    judged = [it for name, it in results.items() if not compare or name == Mode.OFFLOAD.value]
    if any(result.report["violations"] for result in judged) or any(result.trouble for result in results.values()):
        raise typer.Exit(1)


def _run(options: DemoOptions, console: Console, ui: bool) -> DemoResult:
    """Run one mode and report what came out."""
    view = _view(console, options, ui)
    result = run(options, view)
    for line in summary(result.report, options.out):
        view.say(line)
    if result.standstill:
        view.say(result.standstill)
    return result


def _compare(results: Mapping[str, DemoResult], out: Path, console: Console) -> None:
    """Write the comparison of the modes and show it as a table."""
    from robot_offload_lab.judge import compare  # noqa: PLC0415 - matplotlib would make every start a second longer

    runs = {name: (result.report, recording.read(result.recording)) for name, result in results.items()}
    for line in compare.lines(compare.write(runs, out)):
        console.print(line, markup=False, highlight=False)
    console.print(f"Comparison: {out / 'compare.png'} (also compare.json)")


def _found(spec: Path | None, example: str = "") -> Path:
    """Return the given specification, or that of an example of the repository that this runs in or comes from.

    Raises:
        InputError: both are named, there is no such example, or there is no repository.
    """
    if spec is not None and example:
        raise InputError("SPEC and --example: name one of the two")
    if spec is not None:
        return spec
    wanted = example or DEFAULT_EXAMPLE
    here = Path.cwd()
    for folder in (here, *here.parents, *Path(__file__).resolve().parents):
        known = sorted(path.parent.name for path in (folder / "examples").glob(f"*/{FILE}"))
        if wanted in known:
            return folder / "examples" / wanted / FILE
        if DEFAULT_EXAMPLE in known:
            raise InputError(f"--example: {wanted!r} is not one of {', '.join(known)}")
    raise InputError(
        f"SPEC: name a file with a RobotOffload; without one the demo drives the example {wanted}, which is in the "
        "repository and not in the installed package"
    )


def _duration_s(given: float | None) -> float | None:
    if given is not None and not (math.isfinite(given) and given > 0):
        raise InputError(f"--duration: {given:g} s is not a valid duration; write for example --duration 20")
    return given


def _phases(given: Sequence[str] | None, default: str) -> tuple[str, ...]:
    """Return the phases of an option that can be given more than once; `none` means no phases."""
    wanted = [default] if given is None and default else given or ()
    return tuple(text for text in wanted if text != NONE)


def _view(console: Console, options: DemoOptions, ui: bool) -> View:
    if not ui or not console.is_terminal:
        return LineView(console)
    return LiveView(console, f"Robot Offload: {options.spec.parent.name}, {options.mode.value}, seed {options.seed}")
