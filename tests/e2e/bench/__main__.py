"""`python -m tests.e2e.bench`: a cluster, measurements, out/e2e/results.json and docs/benchmarks-e2e.md."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from robot_offload_lab.cluster.cluster import Cluster
from robot_offload_lab.cluster.preflight import preflight
from tests.e2e import figures
from tests.e2e.bench import first_drive, latency, page, recovery
from tests.e2e.bench.place import Place
from tests.e2e.chart import Chart
from tests.e2e.images import provide

GROUPS: Final[Mapping[str, Callable[[Place], None]]] = {
    first_drive.GROUP: first_drive.measure,
    latency.GROUP: latency.measure,
    recovery.GROUP: recovery.measure,
}
PAGE: Final = Path(__file__).parents[3] / "docs" / "benchmarks-e2e.md"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures what was asked for; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.e2e.bench", description=__doc__)
    parser.add_argument("group", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}; default: all of them")
    parser.add_argument(
        "--quick", action="store_true", help="fewer repetitions, shorter windows, the default transport only"
    )
    parser.add_argument("--no-page", action="store_true", help=f"leave {PAGE.relative_to(PAGE.parents[1])} as it is")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.group) - set(GROUPS))
    if unknown:
        parser.error(f"{unknown[0]} is no group; these are {', '.join(GROUPS)}")
    if why := preflight():
        sys.stderr.write(why + "\n")
        return 2
    images = provide(figures.tell)
    with Cluster.up(nodes=2, say=figures.tell) as cluster:
        cluster.import_images(*images.archives)
        Chart(cluster, images).install()
        place = Place(cluster, images, quick=options.quick)
        for name in options.group or GROUPS:
            figures.tell(f"-- {name}")
            with figures.of(name):
                GROUPS[name](place)
    if not options.no_page:
        PAGE.write_text(page.text(figures.taken(), quick=options.quick), encoding="utf-8")
        figures.tell(f"written: {PAGE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
