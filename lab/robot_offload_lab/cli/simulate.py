"""`robot-offload simulate`: try a switching policy on a recorded link before a robot does."""

from __future__ import annotations

import dataclasses
import importlib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Final

import typer

from robot_offload.api.v1alpha1.quantities import parse_duration
from robot_offload.cli.app import example_text
from robot_offload.errors import InputError
from robot_offload_core.words.settings import Settings
from robot_offload_lab.replay.named import POLICIES

PLOTS: Final = ("numpy", "matplotlib")
EXAMPLES = (
    "robot-offload simulate --trace examples/traces/corridor-wifi.txt --tolerance 20ms",
    "robot-offload simulate --trace link.csv@100ms --compare --out out/simulate",
    "robot-offload simulate --trace link.csv --policy mypolicy:make --json | jq .ratio_best_fixed",
    "robot-offload simulate --trace wifi.txt@20ms --trace phone.txt@100ms --tune --report-on site.txt@50ms",
)


def add_to(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("simulate", epilog=example_text(EXAMPLES))(simulate)


def _option(name: str, metavar: str, text: str) -> Any:
    """Return an option with a value; its default stands in the signature."""
    return typer.Option(f"--{name}", metavar=metavar, help=text)


Traces = Annotated[
    list[str] | None,
    _option(
        "trace",
        "FILE[@TOLERANCE]",
        "Recorded round-trip times: one in ms per line, measured back to back, or CSV t_s,rtt_ms with an empty rtt_ms "
        "for a lost request. More than once, each with a tolerance of its own if need be.",
    ),
]
PolicyName = Annotated[
    str,
    _option(
        "policy",
        "NAME",
        f"One of {', '.join(POLICIES)}, or module:function for your own (docs/how-to/try-a-policy.md).",
    ),
]
Tolerance = Annotated[str, _option("tolerance", "TIME", "How much slower the loop through the cloud may be.")]
RobotPeriod = Annotated[str, _option("robot-period", "TIME", "Time between two outputs of the robot's replica.")]
CloudPeriod = Annotated[str, _option("cloud-period", "TIME", "The same for the cloud's replica.")]
LossTimeout = Annotated[
    str | None,
    _option(
        "loss-timeout",
        "TIME",
        "Silence that ends a stay in the cloud. By default 90ms, or three medians of a slower recording.",
    ),
]
WeightsText = Annotated[
    str,
    _option(
        "weights",
        "E/W/S",
        "Price of a second exposed, a second wasted, and a switch: J = E * exposed_s + W * wasted_s + S * switches.",
    ),
]
Compare = Annotated[bool, typer.Option("--compare", help="Replay all policies and print a table.")]
Tune = Annotated[
    bool,
    typer.Option(
        "--tune",
        help="Search figures of our rule on the traces, and report on those of --report-on; without them each trace in "
        "turn is left out and reported on.",
    ),
]
ReportOn = Annotated[
    list[str] | None,
    _option("report-on", "FILE[@TOLERANCE]", "With --tune: recordings to report on, none of those searched."),
]
Out = Annotated[Path | None, _option("out", "DIR", "Folder for results.json and placement.png.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the results as JSON on standard output.")]


def simulate(
    *,
    trace: Traces = None,
    policy: PolicyName = "ours",
    tolerance: Tolerance = "30ms",
    robot_period: RobotPeriod = "50ms",
    cloud_period: CloudPeriod = "20ms",
    loss_timeout: LossTimeout = None,
    weights: WeightsText = "10/1/0.5",
    compare: Compare = False,
    tune_figures: Tune = False,
    report_on: ReportOn = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Try a switching policy on a recorded link: where it would have acted, and what that would have cost.

    The link is good enough at a moment if a heartbeat sent then is back within robotPeriod + tolerance - cloudPeriod.
    A policy is exposed while it acts in the cloud and the link is not good enough, and wastes time while it acts on the
    robot and the link is; J counts both, and the switches. Everybody starts on the robot and leaves the cloud when
    nothing has come for the loss timeout. The optimum is the least J of all, found with the whole recording known;
    ratio is J / optimum. The best fixed rule is the best of a grid of rent-or-buy rules, chosen in hindsight. Ends with
    0, or with 2 when the input is wrong.
    """
    if not trace:
        raise InputError("--trace: name a recording, for example --trace examples/traces/corridor-wifi.txt")
    if report_on and not tune_figures:
        raise InputError("--report-on: only with --tune; without it every --trace is reported on")
    times = _Times(tolerance, robot_period, cloud_period, loss_timeout)
    work = _work()
    request = work.Request(
        recordings=tuple(_recording(work, "--trace", text, times) for text in trace),
        report_on=tuple(_recording(work, "--report-on", text, times) for text in report_on or []),
        policy=policy,
        compare=compare,
        tune=tune_figures,
        weights=_weights(weights),
        out=out,
        as_json=as_json,
    )
    answer = work.run(request)
    if answer is not None:
        typer.echo(answer)


def _work() -> ModuleType:
    """Return what needs numpy and matplotlib, which are an extra of this package, loaded only when it is wanted."""
    try:
        return importlib.import_module("robot_offload_lab.replay.command")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in PLOTS:
            raise
        raise InputError(
            "simulate: needs numpy and matplotlib; install them: pip install 'robot-offload[plots]'"
        ) from error


# -- reading options --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Times:
    """Durations as they were written."""

    tolerance: str
    robot_period: str
    cloud_period: str
    loss_timeout: str | None


def _recording(work: ModuleType, option: str, text: str, times: _Times) -> Any:
    file, tolerance_ms = _file_and_tolerance(option, text, _ms("--tolerance", times.tolerance))
    return work.TraceRequest(file, _settings(tolerance_ms, times), adapt=times.loss_timeout is None)


def _file_and_tolerance(option: str, text: str, default_ms: int) -> tuple[Path, int]:
    name, at, tolerance = text.rpartition("@")
    if not at or Path(text).exists():  # a file may have an @ in its name
        return Path(text), default_ms
    return Path(name), _ms(f"{option} {text}", tolerance)


def _settings(tolerance_ms: int, times: _Times) -> Settings:
    robot_period_ms, cloud_period_ms = (
        _ms("--robot-period", times.robot_period),
        _ms("--cloud-period", times.cloud_period),
    )
    settings = Settings(
        robot_period_s=robot_period_ms / 1e3, cloud_period_s=cloud_period_ms / 1e3, tolerance_s=tolerance_ms / 1e3
    )
    if settings.allowed_loop_s <= 0:
        raise InputError("--tolerance: robot period + tolerance - cloud period must be more than 0ms")
    if times.loss_timeout is None:
        return settings
    loss_timeout_ms, least_ms = _ms("--loss-timeout", times.loss_timeout), round(2 * settings.beat_period_s * 1e3)
    if loss_timeout_ms <= least_ms:
        raise InputError(f"--loss-timeout: must be more than two heartbeats ({least_ms}ms), one lost beat is normal")
    return dataclasses.replace(settings, loss_timeout_s=loss_timeout_ms / 1e3)


def _ms(option: str, text: str) -> int:
    try:
        return parse_duration(text)
    except ValueError as error:
        raise InputError(f"{option}: {error}") from None


def _weights(text: str) -> tuple[float, float, float]:
    try:
        exposed, wasted, switch = (float(part) for part in text.split("/"))
    except ValueError:
        raise InputError(f"--weights: {text!r}: write three numbers, for example 10/1/0.5") from None
    if not all(0 < price < 1e9 for price in (exposed, wasted, switch)):
        raise InputError(f"--weights: {text!r}: every price must be more than 0")
    return exposed, wasted, switch
