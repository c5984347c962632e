"""Goals and calls beside the two sides: relays, the nodes' servers, clients."""

from __future__ import annotations

from robot_offload_core.fence.token import Site
from robot_offload_core.relay.process import RelayPlan
from robot_offload_sim.sides.clients import Clients
from robot_offload_sim.sides.cloud_side import CloudSide
from robot_offload_sim.sides.outside import Outside
from robot_offload_sim.sides.relays import CloudRelayShell, RobotRelayShell
from robot_offload_sim.sides.robot_side import RobotSide
from robot_offload_sim.world.ports import Surroundings
from robot_offload_sim.world.servers import Servers


class Handing:
    """Connects the relays with the sides.

    Attributes:
        robot, cloud: the relays.
        servers: of each side.
        clients: on the robot, with the promises to them.
        outside: the action server outside the group, and its clients in the group.
    """

    def __init__(self, around: Surroundings, robot: RobotSide, cloud: CloudSide, plan: RelayPlan) -> None:
        self.robot = RobotRelayShell(around, robot.host, robot.control.peers, plan)
        self.cloud = CloudRelayShell(around, cloud.host, cloud.control.peers, plan)
        self.robot.memory = lambda: robot.collector.kept
        of = {s.name: s.node for s in plan.services} | {a.name: a.node for a in plan.actions}
        self.servers = {
            site: Servers(around.world, site, side.nodes, of)
            for site, side in ((Site.ROBOT, robot), (Site.CLOUD, cloud))
        }
        for relay, site in ((self.robot, Site.ROBOT), (self.cloud, Site.CLOUD)):
            relay.servers = self.servers[site]
            self.servers[site].feed = relay.feed
        self.clients = Clients(around.world, plan, self.robot, self.cloud, self.servers)
        self.robot.clients = self.cloud.clients = self.clients
        self.outside = Outside(around.world, robot.host, plan, self.robot, self.cloud)
        self.robot.beyond = self.cloud.beyond = self.outside
        self.processes = (self.robot, self.cloud)

    def start(self) -> None:
        """Start the relays and what surrounds them."""
        for process in self.processes:
            process.start()
        for servers in self.servers.values():
            servers.start()
        self.clients.start()
        self.outside.start()
