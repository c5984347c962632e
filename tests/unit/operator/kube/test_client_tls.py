"""The adapter over HTTPS: what it follows no more leaves no connection behind."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import gc
import ssl
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from socket import create_server

from robot_offload.kube.configuration import connect
from robot_offload_lab.cluster.certificates import Authority
from tests.unit.operator.kube.test_client import kubeconfig

HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nTransfer-Encoding: chunked\r\n\r\n"


@contextmanager
def one_line(folder: Path) -> Iterator[str]:
    """A server that answers one request with one line and no end, and never says goodbye; its kubeconfig."""
    Authority(folder / "pki", dt.datetime.now(dt.UTC)).server("server", ["127.0.0.1"])
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "pki/server.crt", folder / "pki/server.key")
    over = threading.Event()
    with create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            plain, _ = listening.accept()
            with context.wrap_socket(plain, server_side=True) as talk:
                talk.recv(65536)
                talk.sendall(HEAD + b"5\r\nline\n\r\n")
                over.wait(60)
                with contextlib.suppress(OSError):  # nobody is there any more
                    talk.recv(1)

        serving = threading.Thread(target=serve)
        serving.start()
        trust = {"certificate-authority": str(folder / "pki/ca.crt")}
        try:
            yield kubeconfig(folder, listening.getsockname()[1], scheme="https", **trust)
        finally:
            over.set()
            serving.join()


def test_a_stream_that_is_followed_no_more_is_cut_at_once_although_its_server_never_says_goodbye(
    tmp_path: Path,
) -> None:
    async def main(path: str) -> bytes:
        api = connect(path)
        heard: asyncio.Queue[bytes] = asyncio.Queue()

        async def follow() -> None:
            async for line in api.lines("/stream", idle_s=60.0):
                heard.put_nowait(line)

        following = asyncio.create_task(follow())
        try:
            return await heard.get()
        finally:
            following.cancel()
            await asyncio.gather(following, return_exceptions=True)
            await api.close()

    with one_line(tmp_path) as path, warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        assert asyncio.run(main(path)) == b"line\n"
        gc.collect()
    assert [str(each.message) for each in found if each.category is ResourceWarning] == []
