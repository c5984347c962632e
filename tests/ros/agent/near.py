"""Stands beside an end of the tunnel as a router does: `near.py robot PORT` dials and sends, `cloud PORT` answers.

The robot's side writes a line for each answer.
"""

import asyncio
import sys
from contextlib import suppress

PERIOD_S = 0.02


async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Sends back what comes."""
    with suppress(OSError):
        while data := await reader.read(4096):
            writer.write(data)
    writer.close()


async def ask(port: int) -> None:
    """Dials, and sends until the connection ends."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    sending = asyncio.create_task(send(writer))
    with suppress(OSError):
        while await reader.readline():
            sys.stdout.write("answered\n")
            sys.stdout.flush()
    sending.cancel()
    writer.close()


async def send(writer: asyncio.StreamWriter) -> None:
    """Sends a line every 20 ms."""
    while True:
        writer.write(b"beat\n")
        await asyncio.sleep(PERIOD_S)


async def main(side: str, port: int) -> None:
    """Runs until it is killed."""
    if side == "cloud":
        async with await asyncio.start_server(answer, "127.0.0.1", port) as server:
            await server.serve_forever()
    while True:
        with suppress(OSError):
            await ask(port)
        await asyncio.sleep(PERIOD_S)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
