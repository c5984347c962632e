"""The bundle's texts for people and systemd."""

from __future__ import annotations

import re
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from typing import Final

from robot_offload.api.v1alpha1 import Node, RobotOffload
from robot_offload.api.v1alpha1.names import Side
from robot_offload.render.launch_file import LAUNCH_FILE
from robot_offload.render.ros_names import action_names, command, nodes_on, private_names, remappings

SETUP_VARIABLE: Final = "ROBOT_OFFLOAD_SETUP"
"""In the file `environment`: the script that sets up ROS 2 and the robot's own message types."""

INSTALL: Final = """\
## Install the agent

`robot-offload-agent --version` answers when it is installed. Else take the wheels that `make dist` writes and, on the
robot, as root:

```sh
python3 -m venv --system-site-packages /opt/robot-offload
/opt/robot-offload/bin/pip install --constraint constraints.txt robot_offload_core-*.whl robot_offload_agent-*.whl
ln -s /opt/robot-offload/bin/robot-offload-{agent,tunnel} /usr/local/bin/
```

Or build `core` and `agent` of the repository with colcon in your workspace, or take the container below.
`docs/how-to/robot.md` has all ways, and what the robot must have: a synchronised clock first of all."""

RECORDING: Final = """\
## Install what recordings need

This robot is to write a recording of each changeover (`spec.record`). The agent needs the library `mcap` for that, its
extra `robot-offload-agent[record]`:

```sh
/opt/robot-offload/bin/pip install mcap
```

In the container it comes with `--build-arg EXTRAS="mcap lz4 zstandard"`. Without it the robot drives and records
nothing; the log and `robot-offload-agent doctor` say so."""

WATCHDOG_S: Final = 15
"""A supervisor silent for this long is restarted with all its processes; it gives a sign of life every 5 s."""

ROUTER_PRIORITY: Final = 5
"""As the tunnel beside it requests."""

_MEANINGS: Final = {
    "agent.yaml": "the agent's configuration, a ROS 2 parameter file",
    "ddsrouter.yaml": "the configuration of the DDS Router on the robot",
    "environment": "ROS 2 settings of the agent; your own nodes need the same ones",
    "certificates/ca.pem": "by which the robot knows its cloud",
    "certificates/robot.pem": "by which the cloud knows the robot",
    "certificates/robot.key": "the key to it; whoever has it is the robot. Mode 0600",
    "robot-offload-agent.service": "starts the agent with systemd",
    "robot-offload-router.service": "starts the DDS Router with systemd",
    "robot-offload-tunnel.service": "starts the tunnel with systemd",
    "robot.launch.py": "starts a launch file of yours, unchanged, under the remappings, and the agent beside it",
    "tunnel.yaml": "the configuration of the tunnel, through which the DDS Router reaches the cloud",
    "compose.yaml": "starts the same in containers instead",
    "README.md": "this page",
}


def instance(name: str, side: Side) -> str:
    """Return the name for the folders of one side's agent."""
    return name if side == "robot" else f"{name}-cloud"


def state_dir(name: str) -> str:
    """Return the folder for what survives a reboot of the robot."""
    return f"/var/lib/robot-offload/{name}"


def runtime_dir(name: str) -> str:
    """Return the folder for sockets and pid files on the robot."""
    return f"/run/robot-offload/{name}"


def setup_file(offload: RobotOffload) -> str:
    """Return the script, on the robot, that sets up ROS 2 and the robot's own message packages in a shell."""
    own = offload.spec.robot.interfaces
    return distro_setup_file(offload) if own is None else own.setup


def distro_setup_file(offload: RobotOffload) -> str:
    """Return the script that sets up the distribution alone in a shell."""
    return f"/opt/ros/{offload.spec.robot.ros_distro}/setup.bash"


def agent_unit(
    offload: RobotOffload,
    folder: str,
    realtime_priority: int,
    environment: Mapping[str, str],
    key: str,
    side: Side = "robot",
) -> str:
    """Return a systemd unit that runs the agent.

    Args:
        offload: the resource.
        folder: the bundle's folder on the robot.
        realtime_priority: the highest that the agent may request.
        environment: beside the file `environment`.
        key: the bundle's file with the private key; empty: this transport has none.
        side: of the agent; both may run on one computer.
    """
    name = instance(offload.metadata.name, side)
    # `$$` leaves a `$` to the shell, in systemd's syntax.
    start = f'source "$${SETUP_VARIABLE}" && exec robot-offload-agent {side} --params {shlex.quote(folder)}/agent.yaml'
    return _unit(
        f"Robot Offload agent of {name}",
        [
            "Type=notify",
            f"WatchdogSec={WATCHDOG_S}",
            f"EnvironmentFile={folder}/environment",
            f"Environment={' '.join(f'{name}={value}' for name, value in environment.items())}",
            f"ExecStart=/bin/bash -c '{start}'",
            f"RuntimeDirectory=robot-offload/{name}",
            f"StateDirectory=robot-offload/{name}",
            *_unprivileged(folder, key, realtime_priority),
        ],
    )


def router_unit(offload: RobotOffload, folder: str) -> str:
    """Return a systemd unit that runs the DDS Router."""
    return _unit(
        f"DDS Router of {offload.metadata.name}",
        [
            "Type=exec",
            f"ExecStart=/usr/bin/env ddsrouter -c {folder}/ddsrouter.yaml",
            # Heartbeats pass through the router, which does not request a priority itself.
            "CPUSchedulingPolicy=fifo",
            f"CPUSchedulingPriority={ROUTER_PRIORITY}",
            "CapabilityBoundingSet=",
        ],
    )


def tunnel_unit(offload: RobotOffload, folder: str, realtime_priority: int, key: str) -> str:
    """Return a systemd unit that runs the robot's end of the tunnel; see `agent_unit`."""
    start = f'source "$${SETUP_VARIABLE}" && exec robot-offload-tunnel --params {shlex.quote(folder)}/tunnel.yaml'
    return _unit(
        f"Robot Offload tunnel of {offload.metadata.name}",
        [
            f"EnvironmentFile={folder}/environment",
            f"ExecStart=/bin/bash -c '{start}'",
            # The agent keeps the robot's renewed certificates there.
            f"StateDirectory=robot-offload/{offload.metadata.name}",
            *_unprivileged(folder, key, realtime_priority),
        ],
    )


USER: Final = "robot-offload"
"""Of agent and tunnel: systemd creates it while one of them runs, unless it exists on the robot. Both share it, because
the tunnel reads the certificates that the agent renews."""


def _unprivileged(folder: str, key: str, realtime_priority: int) -> list[str]:
    """Return the settings for our own programs without root: a user, real-time priority, and the readable key."""
    name = key.rpartition("/")[2]
    handed_over = [
        f"LoadCredential={name}:{folder}/{key}",
        # The key stays root's. The configuration names it by its own path, in containers as well. If it cannot be
        # handed over (`-`), the robot drives on its own instead of not at all.
        f"BindReadOnlyPaths=-/run/credentials/%n/{name}:{folder}/{key}",
    ]
    return [
        f"User={USER}",
        "DynamicUser=true",
        *(handed_over if key else ()),
        f"LimitRTPRIO={realtime_priority}",
        "CapabilityBoundingSet=CAP_SYS_NICE",
        "AmbientCapabilities=CAP_SYS_NICE",
        # Netlink: DDS and Zenoh look at the network's interfaces.
        "RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK",
        "SystemCallFilter=@system-service",
        "SystemCallErrorNumber=EPERM",
        "SystemCallArchitectures=native",
        "PrivateDevices=true",
        "UMask=0077",
    ]


_CLOSED = (
    "ProtectKernelTunables", "ProtectKernelModules", "ProtectKernelLogs", "ProtectControlGroups", "ProtectHostname",
    "RestrictSUIDSGID", "RestrictNamespaces", "LockPersonality",
)  # fmt: skip
"""Kernel features that none of our programs needs."""


def _unit(description: str, service: Sequence[str]) -> str:
    lines = [
        "[Unit]",
        f"Description={description}",
        # Not after network-online: the robot starts without a network as well.
        "After=network.target",
        # Otherwise systemd gives up for ever after five quick failures: a disk mounted late, a clock set late.
        "StartLimitIntervalSec=0",
        "",
        "[Service]",
        *service,
        "Restart=always",
        "RestartSec=1",
        "NoNewPrivileges=true",
        "ProtectSystem=strict",
        "ProtectHome=read-only",
        "PrivateTmp=true",
        *(f"{word}=true" for word in _CLOSED),
        "",
        "[Install]",
        "WantedBy=multi-user.target",
    ]
    return "\n".join(lines) + "\n"


def readme(offload: RobotOffload, folder: str, files: Sequence[str]) -> str:
    """Return the instructions for using the bundle, and for doing without it."""
    parts = [
        f"# Robot Offload: the bundle of {offload.metadata.name}",
        "Everything that the robot needs. It works without the cluster and without a network.",
        "\n".join(
            ["| file | what it is |", "|---|---|", *(f"| `{one}` | {_MEANINGS[one]} |" for one in sorted(files))]
        ),
        INSTALL,
        *([RECORDING] if offload.spec.record.switches else ()),
        _install(offload, folder),
        _nodes(offload, folder),
        _driver(offload),
        _back(offload),
        _again(),
    ]
    return "\n\n".join(parts) + "\n"


def _install(offload: RobotOffload, folder: str) -> str:
    router = offload.spec.transport.type == "DDSRouter"
    units = ["robot-offload-agent", *(["robot-offload-tunnel", "robot-offload-router"] if router else [])]
    enable = " ".join(units)
    copies = "\n".join(f"sudo cp {folder}/{unit}.service /etc/systemd/system/" for unit in units)
    return f"""\
## Start it

With systemd, run in this folder on the robot:

```sh
sudo mkdir -p {folder}
sudo cp -r . {folder}
sudo chown -R root:root {folder}
sudo find {folder} ! -name '*.key' -exec chmod go+rX {{}} +
{copies}
sudo systemctl daemon-reload
sudo systemctl enable --now {enable}
```

{_messages(offload, folder)}

Or start it in containers: copy the folder with the first four commands, then
`cd {folder} && sudo docker compose up -d`. There your message types come with the agent's image.

Look at it:

- `sudo bash -c 'source {setup_file(offload)} && robot-offload-agent robot --params {folder}/agent.yaml --check'`:
  is the configuration good?
- `ros2 topic echo --qos-durability transient_local /offload/placement`: which side acts, and why?
- `journalctl -u robot-offload-agent`: the rest."""


def _messages(offload: RobotOffload, folder: str) -> str:
    own = offload.spec.robot.interfaces
    if own is not None:
        return f"The agent takes your message types from `{own.setup}`, as the RobotOffload says."
    return (
        "Your own message types must be known to the agent: write the setup script of your workspace behind "
        f"`{SETUP_VARIABLE}=`\nin `{folder}/environment`."
    )


def _nodes(offload: RobotOffload, folder: str) -> str:
    spec = offload.spec
    lines = ["## Start your nodes", ""]
    remapped = [node for node in nodes_on(spec, "robot") if private_names(node) or action_names(node)]
    if not remapped:
        return "\n".join([*lines, "As you always did: nothing about them changes."])
    lines += [
        "The outputs of duplicated nodes go through the agent, which passes one side's messages. So these nodes",
        "publish under another name on the robot; services and actions likewise, an action by its five hidden names.",
        "Nodes that are not listed here start as they always did.",
        "",
        "From a launch file of yours, as it is; each rule names its node, composed ones included:",
        "",
        fenced(f"ros2 launch {folder}/{LAUNCH_FILE} launch:=my_bringup/robot.launch.py agent:=false"),
        "",
        "Without `agent:=false` the agent is started there as well, instead of by systemd. A rule meets the name in",
        "the program: where your launch file remaps one of these names, write that under `run.remap` of the node.",
        "",
        "Or one by one:",
        "",
    ]
    for node in remapped:
        rules = remappings(spec, node, "robot")
        arguments = " ".join(f"-r {shlex.quote(f'{source}:={target}')}" for source, target in rules.items())
        lines += [f"- `{node.name}`: add `--ros-args {arguments}`", *_whole_command(offload, node), ""]
    lines += ["The shell that starts them needs the settings of `environment` too."]
    return "\n".join(lines)


def _whole_command(offload: RobotOffload, node: Node) -> list[str]:
    if node.run is None:
        return []
    return ["", textwrap.indent(fenced(shlex.join(command(offload.spec, node, "robot"))), "  ")]


def fenced(text: str) -> str:
    """Return a Markdown code block that its text cannot leave: the fence is longer than any in it."""
    fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    return f"{fence}sh\n{text}\n{fence}"


def _driver(offload: RobotOffload) -> str:
    service = offload.spec.driver.inhibit_service
    called = f"The agent calls `{service}` to hold the robot while a core node is not active.\n" if service else ""
    return f"""\
## The driver

{called}The driver must stop by itself when no command comes for some hundred milliseconds. Nothing replaces that:
neither the agent nor this service is ever the only thing that stops the robot."""


def _back(offload: RobotOffload) -> str:
    units = "robot-offload-agent"
    if offload.spec.transport.type == "DDSRouter":
        units += " robot-offload-tunnel robot-offload-router"
    return f"""\
## How to go back without us

1. `sudo systemctl disable --now {units}` (or `sudo docker compose down`).
2. Start your nodes without the remappings above. They are unchanged and publish to their consumers directly again.
3. Lifecycle nodes: let your own lifecycle manager bring them up, as before.

Nothing else on the robot was changed."""


def _again() -> str:
    return """\
## When a new bundle is needed

When the nodes, outputs or topics of the resource change, when the cloud gets another address, when the robot was
revoked, and before the robot's certificate ends. The agent says so with the reason `NeedsBundle`; settings such as
`switching` and a pin reach a connected robot by themselves. Write one with `kubectl offload bundle`, copy it over this
folder and restart the agent."""
