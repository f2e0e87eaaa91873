"""Find the nodes that publish commands for a car, and their plans."""

import os
from contextlib import suppress
from typing import Any, Dict, List, NamedTuple, Optional

import rosgraph
import rospy

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.ros.connections import is_alive
from mushr_ros_intro.ros.xmlrpc_client import CallError, ask
from mushr_ros_intro.stamps import CALL_TIMEOUT


class Sender(NamedTuple):
    """A node that publishes commands on an input of the mux."""

    name: str
    topic: str
    address: str
    """Another one if a node of the same name has replaced it."""
    parameters: Dict[str, Any]

    @property
    def places_car(self) -> bool:
        """Return whether the node places the car at the start pose, as far as is known."""
        return self.parameters.get("send_init_pose") is not False

    @property
    def max_speed(self) -> float:
        """The limit of its commands [m/s]; infinite if none is set."""
        value = self.parameters.get("max_speed")
        is_number = isinstance(value, (int, float)) and value > 0.0
        return float(value) if is_number else float("inf")  # type: ignore


class Senders:
    """The nodes that publish on the inputs of a mux, as the master knows them.

    A subscription to the inputs would tell their names, too. But then a node that waits for a
    subscriber would begin without a car.

    Args:
        inputs: the beginning of the topics of the inputs.
    """

    def __init__(self, inputs: str) -> None:
        self._inputs = inputs
        self._master = rosgraph.Master(rospy.get_name())
        self.known: Dict[str, Sender] = {}
        """The senders by name, when the master was asked last."""

    def look(self) -> List[Sender]:
        """Find the senders; return those that were not known.

        Raises:
            rosgraph.MasterException, OSError: the master does not answer.
        """
        topics, _, _ = self._master.getSystemState()
        pairs = {
            name: topic
            for topic, names in topics
            if topic.startswith(self._inputs)
            for name in names
        }
        found, new = {}, []
        for name, topic in pairs.items():
            with suppress(rosgraph.MasterException):  # it has just ended
                address = self._master.lookupNode(name)
                known = self.known.get(name)
                if not is_alive(name):
                    continue  # it was killed, and remains registered
                if known and known.address == address and known.topic == topic:
                    found[name] = known
                else:
                    found[name] = Sender(name, topic, address, self._parameters(name))
                    new.append(found[name])
        self.known = found
        return new

    def driver(self, name: Optional[str]) -> Optional[Sender]:
        """Return the node of a drive that has just begun; None, with a warning, if it is not known.

        Args:
            name: of the node, as the mux publishes it; None: the mux does not.
        """
        senders = list(self.known.values())
        if name:  # if it has ended, its parameters remain
            senders = [self.known.get(name) or Sender(name, "", "", {})]
        with_plan = [each for each in senders if "plan_file" in each.parameters]
        for found in (senders, with_plan):
            if len(found) == 1:
                return found[0]._replace(parameters=self._parameters(found[0].name))
        names = ", ".join(each.name for each in senders) or "none"
        rospy.logwarn("the node of the drive is not known; nodes that publish commands: %s", names)
        return None

    def is_input_of(self, sender: Sender, active: str) -> bool:
        """Return whether `active` is the mux's name of the input on which a node publishes."""
        name = sender.topic[len(self._inputs) :].lower()
        return active.lower().startswith(name)  # MuSHR's mux names teleop Teleoperation

    def _parameters(self, name: str) -> Dict[str, Any]:
        values: Any = {}
        with suppress(rosgraph.MasterException, OSError):
            values = self._master.getParam(name)
        return values if isinstance(values, dict) else {}


def plan_of(sender: Sender) -> Optional[Plan]:
    """Return the plan in the parameter plan_file of a node, None if it has no such parameter.

    Raises:
        UserError: the plan cannot be found or read.
    """
    name = sender.parameters.get("plan_file")
    if not isinstance(name, str) or not name:
        return None
    if not os.path.isabs(name):
        name = os.path.join(_folder_of(sender), name)
    return read_plan(name)


def _folder_of(sender: Sender) -> str:
    """Return the working directory of a node on this machine, where its relative paths begin.

    Raises:
        UserError: the node has ended, or runs on another machine.
    """
    try:
        pid = ask(sender.address, CALL_TIMEOUT, rospy.get_name(), "getPid")
        return os.readlink(f"/proc/{pid}/cwd")
    except (CallError, OSError):
        text = "its ~plan_file is a relative path, and the node has ended or is on another machine"
        raise UserError(text) from None
