"""The pipes of the programs that a run follows: JSON commands to them, lines of text from them."""

from __future__ import annotations

import json
import os
import select
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import suppress

_BLOCK_BYTES = 1 << 16


class Pipes:
    """Standard input and output of children, by name. For one thread; reading never waits longer than requested."""

    def __init__(self) -> None:
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._unread: dict[str, bytes] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._children

    def add(self, name: str, child: subprocess.Popen[bytes]) -> None:
        """Follow a child whose standard input and output are pipes."""
        assert child.stdout is not None
        os.set_blocking(child.stdout.fileno(), False)
        self._children[name] = child

    def close(self, name: str) -> None:
        """Close a child's standard input and stop following it."""
        child = self._children.pop(name)
        self._unread.pop(name, None)
        if child.stdin is not None:
            with suppress(OSError):
                child.stdin.close()

    def command(self, name: str, command: Mapping[str, object]) -> None:
        """Write one command. A command to a child that has ended is dropped; `Ensemble.check` reports that."""
        pipe = self._children[name].stdin
        assert pipe is not None
        with suppress(BrokenPipeError):
            pipe.write(json.dumps(command).encode() + b"\n")
            pipe.flush()

    def look(self, seconds: float) -> Iterator[tuple[str, str]]:
        """Yield (name, line) of what was printed; wait up to `seconds` for output."""
        found = {child.stdout.fileno(): name for name, child in self._children.items() if child.stdout is not None}
        for descriptor in select.select(list(found), [], [], seconds)[0]:
            name = found[descriptor]
            data = os.read(descriptor, _BLOCK_BYTES)
            if not data:
                select.select([], [], [], seconds)  # it has ended, which is noticed elsewhere
            *lines, self._unread[name] = (self._unread.get(name, b"") + data).split(b"\n")
            for line in lines:
                yield name, line.decode(errors="replace")
