"""The scripts of a build Job's containers. Fixed texts: everything variable comes in variables and files.

fetch has the source's credentials and runs in our own image; build runs foreign code and has at most the Secret for
pulling; push has the registry's.
"""

from __future__ import annotations

from typing import Final

SCRATCH: Final = "/scratch"
"""A folder that the three containers share: source, layers, commit, digest."""
FILES_DIR: Final = "/etc/robot-offload/build"
"""The folder of the Dockerfile and the registries' settings."""
GIT_SECRET_DIR: Final = "/run/secrets/git"  # noqa: S105 - a folder
REGISTRY_SECRET_DIR: Final = "/run/secrets/registry"  # noqa: S105 - a folder
DOCKERFILE: Final = "Dockerfile"
REGISTRIES: Final = "registries.conf"
AUTH_FILE: Final = "config.json"
TOKEN_KEYS: Final = ("username", "password")
"""Entries of a Secret of type kubernetes.io/basic-auth."""
SSH_KEYS: Final = ("ssh-privatekey", "known_hosts")
"""Entries of a Secret of type kubernetes.io/ssh-auth, and the keys of the hosts."""

_TRY: Final = """
attempt() {
  count=1
  until "$@"; do
    [ "$count" -lt 3 ] || return 1
    count=$((count + 1))
    sleep 5
  done
}
"""
FETCH: Final = f"""set -eu
{_TRY}
fail() {{ echo "fatal: $1" >&2; exit 1; }}
command -v git > /dev/null || fail "this image has no git; the chart's value images.git names one with git and ssh"
export HOME={SCRATCH}/fetch GIT_TERMINAL_PROMPT=0
rm -rf {SCRATCH}/context "$HOME"
mkdir -p {SCRATCH}/context/src "$HOME"
if [ -f {GIT_SECRET_DIR}/ssh-privatekey ]; then
  [ -f {GIT_SECRET_DIR}/known_hosts ] || fail "the git secret has no entry known_hosts; write the host's keys into it"
  export GIT_SSH_COMMAND='ssh -o BatchMode=yes -o StrictHostKeyChecking=yes -o IdentitiesOnly=yes \\
    -o UserKnownHostsFile={GIT_SECRET_DIR}/known_hosts -i {GIT_SECRET_DIR}/ssh-privatekey'
elif [ -f {GIT_SECRET_DIR}/password ]; then
  git config --global credential.helper '!f() {{ test "$1" != get || {{ \\
    printf "username=%s\\n" "$(cat {GIT_SECRET_DIR}/username)"; \\
    printf "password=%s\\n" "$(cat {GIT_SECRET_DIR}/password)"; }}; }}; f'
fi
cd {SCRATCH}/context/src
git init --quiet .
git remote add origin "$GIT_URL"
if [ -n "$GIT_PATHS" ]; then
  git sparse-checkout init --cone
  printf '%s\\n' "$GIT_PATHS" | git sparse-checkout set --stdin
fi
attempt git fetch --quiet --depth 1 --filter=blob:none origin "$GIT_REF"
git checkout --quiet --detach FETCH_HEAD
git rev-parse HEAD > {SCRATCH}/commit
git log -1 --format=%ct > {SCRATCH}/time
rm -rf .git
echo "Fetched commit $(cat {SCRATCH}/commit)"
"""
ARCHIVE: Final = f"{SCRATCH}/image.tar"
"""The image on its way from build to push, which reads nothing else of the build."""
UNPACKED_DIR: Final = "/var/tmp"  # noqa: S108 - an emptyDir of the container with the credentials alone
"""Where buildah unpacks a pulled archive, regardless of TMPDIR (tried with 1.28)."""
_BUILDAH: Final = f"""
export CONTAINERS_REGISTRIES_CONF={FILES_DIR}/{REGISTRIES} BUILDAH_ISOLATION=chroot STORAGE_DRIVER=overlay
[ ! -f {REGISTRY_SECRET_DIR}/{AUTH_FILE} ] || export REGISTRY_AUTH_FILE={REGISTRY_SECRET_DIR}/{AUTH_FILE}
commit="$(cat {SCRATCH}/commit)"
image="$REPOSITORY:$KEY-$(printf '%.12s' "$commit")"
run() {{ buildah --root "$HOME/layers" --runroot "$HOME/run" "$@"; }}
if ! run info > /dev/null 2>&1; then
  echo "No overlay file system for builds here: whole copies of each layer instead, slower and larger"
  rm -rf "$HOME/layers" "$HOME/run"
  export STORAGE_DRIVER=vfs
fi
"""
BUILD: Final = f"""set -eu
export HOME={SCRATCH}/build TMPDIR={SCRATCH}/temporary
mkdir -p "$HOME" "$TMPDIR"
rm -f {ARCHIVE}
{_BUILDAH}
if run pull --quiet "$image" > /dev/null 2>&1; then
  echo "$image is in the registry already"
else
  run build --layers=false --timestamp "$(cat {SCRATCH}/time)" \\
    --label "org.opencontainers.image.revision=$commit" \\
    --tag "$image" --file {FILES_DIR}/{DOCKERFILE} {SCRATCH}/context
  run push --quiet "$image" "oci-archive:{ARCHIVE}"
fi
"""
# A fresh home: settings or layers that a build step left behind must not affect the holder of the credentials.
PUSH: Final = f"""set -eu
{_TRY}
HOME="$(mktemp -d /tmp/push.XXXXXX)"
export HOME TMPDIR="$HOME"
{_BUILDAH}
from="$image"
[ ! -f {ARCHIVE} ] || from="oci-archive:{ARCHIVE}"
made="$(run pull --quiet "$from")"
attempt run push --quiet --digestfile "$HOME/digest" "$made" "docker://$image"
printf '{{"commit":"%s","digest":"%s"}}' "$commit" "$(cat "$HOME/digest")" > /dev/termination-log
"""
