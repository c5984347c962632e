"""The options that all measurements share, said once."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Final, get_type_hints

import typer

from robot_offload_lab.bench.plan import FULL, QUICK, Amounts, Order
from robot_offload_lab.bench.results import Priority
from robot_offload_lab.run.free import parse_domains

OUT: Final = Path("out/bench")
Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder of results.json, samples (CSV), pictures and logs.")]
FolderOfDocs = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder in which to refresh benchmarks.md and images/ too.")
]


@dataclass(frozen=True, kw_only=True)
class Common:
    """What every measurement can be given; each attribute is an option of every command.

    Attributes:
        full: measure the long form.
        realtime: measure with real-time priority (True), with normal priority (False), or as the command does (None).
        out: folder of the results.
        docs: folder of the page, None for no page.
        resume: skip what was measured today.
        seed: of links and moments.
        domains: ROS domains as they were written.
        as_json: print the results as JSON.
    """

    full: Annotated[bool, typer.Option("--full/--quick", help="Hours for some groups, or a look in minutes.")] = False
    realtime: Annotated[
        bool | None, typer.Option("--realtime/--normal", help="Priority of agents and nodes; `switch` measures both.")
    ] = None
    out: Out = OUT
    docs: FolderOfDocs = None
    resume: Annotated[
        bool, typer.Option("--resume", help="Skip what this folder has from today, measured with the same options.")
    ] = False
    seed: Annotated[int, typer.Option(help="Random seed of the links and of the moments of cuts and switches.")] = 1
    domains: Annotated[
        str, typer.Option(metavar="ROBOT/CLOUD", help="ROS domains of the two sides. Default: free ones.")
    ] = ""
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json on standard output at the end.")] = False

    @property
    def amounts(self) -> Amounts:
        """How much the chosen form measures."""
        return FULL if self.full else QUICK

    @property
    def priority(self) -> Priority:
        """The one priority of commands that measure with one."""
        return "normal" if self.realtime is False else "realtime"

    def order(self, amounts: Amounts, cases: Sequence[str] = ()) -> Order:
        """Returns what the groups are asked to do.

        Raises:
            InputError: `--domains` is wrong.
        """
        domains = parse_domains(self.domains)
        return Order(amounts, self.priority, self.out, self.seed, domains, lambda _: None, tuple(cases))


def measurement(function: Callable[..., None]) -> Callable[..., None]:
    """Gives a command, which takes `common` first, the shared options behind its own."""
    names = [item.name for item in fields(Common)]
    hints = get_type_hints(Common, include_extras=True)

    @functools.wraps(function)
    def command(**options: Any) -> None:
        common = Common(**{name: options.pop(name) for name in names})
        function(common, **options)

    own = list(inspect.signature(function, eval_str=True).parameters.values())[1:]
    shared = [
        inspect.Parameter(item.name, inspect.Parameter.KEYWORD_ONLY, default=item.default, annotation=hints[item.name])
        for item in fields(Common)
    ]
    command.__signature__ = inspect.Signature([*own, *shared])  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, *shared)}
    del command.__wrapped__  # typer reads the type hints of what is wrapped
    return command
