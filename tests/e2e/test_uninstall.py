"""Case 7: everything can be removed in the wrong order."""

from __future__ import annotations

import time

from tests.e2e.chart import Chart
from tests.e2e.faults import WHEELCHAIR, arrived, drive, until_cloud
from tests.e2e.figures import figure
from tests.e2e.story import READY, RESTRICTED, Story
from tests.e2e.waiting import eventually

OURS = "deployments,statefulsets,services,secrets,configmaps,serviceaccounts,roles,rolebindings,leases,networkpolicies"
LABEL = "app.kubernetes.io/managed-by=robot-offload"


def test_the_chart_goes_first_and_what_it_made_can_be_deleted_without_it(story: Story, chart: Chart) -> None:
    robot = drive(story)
    try:
        chart.uninstall()
        robot.rest(5.0)
        until_cloud(robot)  # a robot does not need the operator to drive

        began_s = time.monotonic()
        story.kubectl("delete", "robotoffload", WHEELCHAIR, "--timeout=60s")
        robot.until_site("robot")
        eventually(lambda: not _left(story), "nothing of ours in the namespace", instead=lambda: _left(story))
        figure("resource deleted without an operator to nothing left", time.monotonic() - began_s, "s")
        robot.rest(5.0)
        arrived(robot)
    finally:
        chart.install()


def test_a_namespace_goes_with_everything_in_it_while_its_robot_drives(story: Story) -> None:
    robot = drive(story)

    began_s = time.monotonic()
    story.kubectl.within("")("delete", "namespace", story.namespace, "--timeout=110s")
    figure("namespace deleted while a robot drives", time.monotonic() - began_s, "s")

    robot.until_site("robot")
    robot.rest(3.0)
    arrived(robot)
    # A namespace of the same name is another one, for the operator as well.
    again = {"labels": RESTRICTED, "name": story.namespace}
    story.kubectl.within("").apply({"kind": "Namespace", "apiVersion": "v1", "metadata": again})
    story.apply(story.sample("talker"))
    story.wait_conditions("talker", *READY)


def _left(story: Story) -> list[str]:
    return [*story.kubectl.names(OURS, "-l", LABEL), *story.kubectl.names("pods")]
