import pytest

from robot_offload_core.words.settings import Settings
from robot_offload_lab.bench.groups import commanded, cuts, handover, keeping, resources, silence
from robot_offload_lab.bench.resource import BenchCase, offload

CASES = (
    silence.BAD,
    commanded.CASE,
    cuts.CASE,
    resources.CASE,
    handover.CASE,
    handover.MIRRORED,
    *keeping.CASES,
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_every_case_is_a_resource_whose_settings_work_together(case: BenchCase):
    switching = offload(case).spec.switching
    Settings(
        loss_timeout_s=switching.loss_timeout_ms / 1e3,
        lease_s=switching.lease_ms / 1e3,
        max_command_age_s=switching.max_command_age_ms / 1e3,
        robot_period_s=switching.latency.robot_period_ms / 1e3,
        cloud_period_s=switching.latency.cloud_period_ms / 1e3,
        tolerance_s=switching.latency.tolerance_ms / 1e3,
    ).check()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_tolerance_allows_the_link_of_every_case(case: BenchCase):
    up, down = case.link.schedule().at(0.0)
    four_sigma_ms = 4 * (up.jitter_ms**2 + down.jitter_ms**2) ** 0.5
    assert up.delay_ms + down.delay_ms + four_sigma_ms <= offload(case).spec.switching.latency.allowed_loop_ms


def test_a_case_is_told_in_words():
    assert silence.BAD.describe() == "40ms ± 5ms each way, 3% loss"
    assert commanded.CASE.describe() == "5ms each way"
