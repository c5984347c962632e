"""One cluster for all stories: our chart in it, our images on its nodes. A namespace, and robots, for each story."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot_offload_lab.cluster.any_cluster import AnyCluster
from robot_offload_lab.cluster.choice import Choice, choose
from robot_offload_lab.cluster.errors import NotHereError
from tests.e2e import figures
from tests.e2e.chart import Chart
from tests.e2e.figures import OUT, figure, tell
from tests.e2e.images import Images, provide
from tests.e2e.story import Story

HERE = Path(__file__).parent
LIMIT_S = 600
"""For one story; the tests' common limit is for tests of seconds."""
CHOICE = pytest.StashKey[Choice]()
IMAGES = pytest.StashKey[Images]()
CALL = pytest.StashKey[pytest.TestReport]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What all of them have in common."""
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.e2e)
            item.add_marker(pytest.mark.cluster)
            item.add_marker(pytest.mark.flaky(reruns=1, rerun_except=["BrokenPromiseError"]))
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(LIMIT_S))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Builds what the stories need before the time limit of any of them runs."""
    wanted = any(HERE in item.path.parents for item in session.items)
    if not wanted or session.config.option.collectonly:
        return
    choice = session.config.stash[CHOICE] = choose()
    if choice.missing:
        return
    terminal = session.config.pluginmanager.getplugin("terminalreporter")

    def say(line: str) -> None:
        if terminal is not None:
            terminal.write_line(line, flush=True)

    choice.prepare(say)
    session.config.stash[IMAGES] = provide(say)


@pytest.fixture(scope="session")
def images(request: pytest.FixtureRequest) -> Images:
    """Our images and that of the example nodes; all that needs them is skipped where nodes cannot run."""
    if why := request.config.stash[CHOICE].missing:
        pytest.skip(why)
    return request.config.stash[IMAGES]


@pytest.fixture(scope="session")
def bare_cluster(images: Images, request: pytest.FixtureRequest) -> Iterator[AnyCluster]:
    """A cluster with our images on its nodes and nothing of ours running."""
    with request.config.stash[CHOICE].up(nodes=2, say=tell) as cluster:
        cluster.import_images(*images.archives)
        yield cluster


@pytest.fixture(scope="session")
def chart(bare_cluster: AnyCluster, images: Images) -> Chart:
    """Our chart, installed by helm."""
    chart = Chart(bare_cluster, images)
    figure("helm install to operator ready", chart.install(), "s")
    return chart


@pytest.fixture(scope="session")
def cluster(bare_cluster: AnyCluster, chart: Chart) -> AnyCluster:
    """The cluster with our chart in it."""
    return bare_cluster


@pytest.fixture
def story(cluster: AnyCluster, images: Images, request: pytest.FixtureRequest) -> Iterator[Story]:
    """A namespace for one test; what was there is kept in out/e2e/TEST when it fails."""
    again = getattr(request.node, "execution_count", 1)
    label = request.node.name + (f"-try-{again}" if again > 1 else "")  # what is kept of the first one stays
    with Story(cluster, images, _namespace(label), OUT / label) as story:
        yield story
        report = request.node.stash.get(CALL, None)
        if report is not None and report.failed:
            story.tell_everything()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Skips a story that asks for what this kind of cluster cannot do."""
    try:
        yield
    except NotHereError as error:
        pytest.skip(str(error))


def _namespace(label: str) -> str:
    """A name that no other story has: that of the one before may still be on its way out."""
    words = re.sub(r"[^a-z0-9]+", "-", label.lower().removeprefix("test_"))[:33].strip("-")
    return f"{words}-{hashlib.sha256(label.encode()).hexdigest()[:6]}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Iterator[None]:  # pytest types the result of a wrapper otherwise
    """Remembers how a test went, for the fixtures that end after it."""
    report: pytest.TestReport = yield  # type: ignore[assignment]
    if report.when == "call":
        item.stash[CALL] = report
    return report  # type: ignore[return-value]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What ran, what was skipped and why, and every figure."""
    rows = [
        (report.nodeid.rpartition("/")[2], word, _why(report), getattr(report, "duration", 0.0))  # none if not imported
        for word in ("passed", "failed", "error", "skipped", "rerun")
        for report in terminalreporter.stats.get(word, [])
        if "tests/e2e/" in report.nodeid and (report.when == "call" or word != "passed")
    ]
    if not rows:
        return
    write = terminalreporter.write_line
    terminalreporter.section("end to end: what ran")
    width = max(len(row[0]) for row in rows)
    for name, word, why, seconds in sorted(rows):
        write(f"{name:<{width}}  {word:<8} {seconds:6.1f} s  {why}".rstrip())
    found = figures.taken()
    if found:
        terminalreporter.section(f"end to end: figures ({figures.RESULTS})")
        width = max(len(f"{each.story}: {each.name}") for each in found)
        for each in found:
            write(f"{f'{each.story}: {each.name}':<{width}}  {figures.shown(each.value):>8} {each.unit}".rstrip())


def _why(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Why a test was skipped; empty for all others."""
    if report.outcome != "skipped" or not isinstance(report.longrepr, tuple):
        return ""
    return str(report.longrepr[2]).removeprefix("Skipped: ")
