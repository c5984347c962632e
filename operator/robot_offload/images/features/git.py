"""Source code from a git repository: a sparse checkout of one commit; private ones need secrets of the build."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from robot_offload.api.v1alpha1.build_values import commit
from robot_offload.findings import Finding
from robot_offload.images.features.feature import Feature, Flag, Stage
from robot_offload.images.spec import BuildSpec


class Git(Feature[BuildSpec]):
    """Fetches only the named folders of one commit. Credentials exist only while the command runs."""

    name = "git"
    stages = ("sources",)
    flags = (
        Flag("--git", "git.url", "Git repository with the source code.", metavar="URL"),
        Flag("--ref", "git.ref", "Branch, tag or commit; a commit gives the same image twice. Default HEAD."),
        Flag(
            "--path",
            "git.paths",
            "Folder of the repository that is needed; may be repeated. Default: all of it.",
            "texts",
            "FOLDER",
        ),
        Flag(
            "--credentials",
            "git.credentials",
            "For a private repository: SSH (ssh agent, and the secret known_hosts) or Token (the secret "
            "git-credentials). Default None.",
        ),
    )

    def wanted(self, spec: BuildSpec) -> bool:
        """Return whether the source is a git repository."""
        return spec.git is not None

    def check(self, spec: BuildSpec) -> Iterator[Finding]:
        """Warn that a branch moves, and check that ssh and tokens have an address of their kind."""
        if spec.git is None:
            return
        if commit(spec.git.ref) is None:
            yield Finding(
                "git.ref",
                "NotPinned",
                "is not a commit, so builders with a cache will not see what is pushed later; write the commit's 40 "
                "digits (`robot-offload build --pin` looks it up)",
                "warning",
            )
        https = spec.git.url.startswith("https://")
        over_ssh = spec.git.over_ssh
        if spec.git.credentials == "Token" and not https:
            yield Finding("git.credentials", "WrongCredentials", "Token is for addresses with https://; write SSH")
        if over_ssh and spec.git.credentials != "SSH":
            yield Finding("git.credentials", "WrongCredentials", "this address is read through ssh; write SSH")
        if spec.git.credentials == "SSH" and not over_ssh:
            yield Finding("git.credentials", "WrongCredentials", "SSH is for ssh:// and user@host:path addresses")

    def packages(self, spec: BuildSpec, stage: Stage) -> tuple[str, ...]:
        """Return ssh if needed; the official images have only git."""
        over_ssh = spec.git is not None and spec.git.credentials == "SSH"
        return ("openssh-client",) if over_ssh and stage == "sources" else ()

    def values(self, spec: BuildSpec) -> Mapping[str, Any]:
        """Return the source."""
        return {"git": spec.git}
