"""Golden Dockerfiles: one for every distribution and every feature, held to the linter and to a real parser."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from robot_offload.images.distros import DISTROS
from robot_offload.images.features import NODE_FEATURES, OVERLAY_FEATURES
from robot_offload.images.spec import BuildSpec
from tests.golden.dockerfiles.cases import CASES, generated, golden_path, spec_of
from tests.golden.recorded import compare
from tests.unit.operator.images import parsed

IGNORED = {
    "DL3002": "only stages that are thrown away stay root; the last USER is checked below",
    "DL3003": "cd inside one RUN: a WORKDIR would be one more layer for a single command",
    "DL3006": "our own images and those of users are named as they are given; pinning is the user's choice",
    "DL3008": "Debian packages take the versions of the base image's day; the user pins with name=version",
    "DL3013": "the same for Python packages",
    "DL3042": "pip's cache is a cache mount and not in the image",
    "SC2016": "the script that is written into the image shall expand its variables there",
}


@pytest.mark.parametrize("case", CASES)
def test_a_specification_gives_the_committed_dockerfile_byte_for_byte(case: str) -> None:
    compare(golden_path(case), generated(case))


def test_every_distribution_has_a_golden_dockerfile() -> None:
    assert {spec_of(case).distro for case in CASES} == set(DISTROS)


def test_every_feature_writes_something_in_a_golden_dockerfile() -> None:
    seen = {
        feature.name
        for case in CASES
        for feature in (NODE_FEATURES if isinstance(spec_of(case), BuildSpec) else OVERLAY_FEATURES)
        if feature.wanted(spec_of(case))
    }
    assert seen == {feature.name for feature in (*NODE_FEATURES, *OVERLAY_FEATURES)}


@pytest.mark.parametrize("case", CASES)
def test_the_shell_of_every_run_instruction_is_correct(case: str) -> None:
    commands = parsed.shell_commands(generated(case))
    assert commands or case == "agent-over-image"
    for command in commands:
        for shell in ("bash", "sh"):
            done = subprocess.run([shell, "-n"], input=command, text=True, capture_output=True, check=False)
            assert (done.returncode, done.stderr) == (0, ""), command


@pytest.mark.parametrize("case", CASES)
def test_the_linter_finds_nothing(case: str, tmp_path: Path) -> None:
    path = tmp_path / "Dockerfile"
    path.write_text(generated(case), encoding="utf-8")
    ignores = [word for rule in IGNORED for word in ("--ignore", rule)]
    done = subprocess.run(
        [parsed.program("hadolint"), "--no-color", *ignores, str(path)], text=True, capture_output=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.parametrize("case", CASES)
def test_a_dockerfile_parser_reads_what_we_meant(case: str) -> None:
    instructions = parsed.instructions(generated(case))
    names = [name for name, _ in instructions]
    assert names.count("ENTRYPOINT") == names.count("CMD") == names.count("STOPSIGNAL") == 1
    assert [value for name, value in instructions if name == "USER"][-1] == "{0}:{0}".format(spec_of(case).user_id)
    assert not {"ARG", "ADD", "SHELL", "ONBUILD", "VOLUME"} & set(names)


@pytest.mark.parametrize("case", CASES)
def test_the_same_text_serves_every_architecture(case: str) -> None:
    text = generated(case)
    assert not re.search(r"--platform|BUILDPLATFORM|TARGETARCH|qemu|amd64|arm64|x86_64|aarch64", text)


@pytest.mark.parametrize("case", CASES)
def test_only_the_last_cache_of_a_step_is_locked(case: str) -> None:
    # buildah before 1.29 gives back the last lock of a step only; the next step with such a cache would wait for ever.
    # Nor does it when the folder is tidied up meanwhile, as apt does with its lists: the lock is a file in there.
    for step in re.findall(r"^RUN ((?:--mount=\S+ *\\?\n? *)+)", generated(case), flags=re.MULTILINE):
        caches = [mount for mount in re.findall(r"--mount=(\S+)", step) if mount.startswith("type=cache")]
        assert not any("sharing=locked" in cache for cache in caches[:-1]), step
        assert not caches or ("sharing=locked" in caches[-1] and "/var/lib/apt/lists" not in caches[-1]), step
