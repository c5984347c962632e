"""`python -m robot_offload_lab.bench.parts.fleet KUBECONFIG NAMESPACE COUNT SECONDS`: reporters of many robots.

Renews the Leases `robot-N-robot` as the reporters beside the cloud agents do, each every SECONDS, spread evenly.
"""

from __future__ import annotations

import asyncio
import datetime
import sys

from robot_offload.kube.configuration import connect
from robot_offload.kube.errors import KubeError
from robot_offload.kube.kinds import LEASE
from robot_offload.kube.port import KubeApi

_HANDS = 16


async def main(kubeconfig: str, namespace: str, count: int, period_s: float) -> None:
    """Renew until it is ended."""
    api = connect(kubeconfig)
    try:
        await asyncio.gather(*(_renew(api, namespace, range(hand, count, _HANDS), period_s) for hand in range(_HANDS)))
    finally:
        await api.close()


async def _renew(api: KubeApi, namespace: str, robots: range, period_s: float) -> None:
    loop = asyncio.get_running_loop()
    while True:
        began_s = loop.time()
        for place, number in enumerate(robots):
            await asyncio.sleep(max(0.0, began_s + period_s * place / len(robots) - loop.time()))
            now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
            spec = {"holderIdentity": f"robot-{number}", "renewTime": now}
            try:
                await api.patch(LEASE, namespace, f"robot-{number}-robot", {"spec": spec})
            except KubeError as error:
                sys.stderr.write(f"{error}\n")
        await asyncio.sleep(max(0.1, began_s + period_s - loop.time()))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])))
