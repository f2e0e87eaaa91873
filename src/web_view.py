#!/usr/bin/python3
"""Show the car in a browser, and connect clients that speak rosbridge's protocol."""

import asyncio
import json
import logging
import os
import secrets
from contextlib import suppress
from functools import partial
from typing import Any, Dict

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped

from mushr_ros_intro.browser import plans, rosapi
from mushr_ros_intro.browser.access import refusal
from mushr_ros_intro.browser.bridge import Bridge
from mushr_ros_intro.browser.map import WebMap
from mushr_ros_intro.browser.plan_drive import PlanDrive
from mushr_ros_intro.browser.server import Action, serve
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters, Values, folder, integer, text
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.ros import node
from mushr_ros_intro.ros.connections import is_alive, registered_nodes
from mushr_ros_intro.ros.xmlrpc_client import CallError
from mushr_ros_intro.simulator.car_parameters import (
    COLLISION,
    FOOTPRINTS,
    simulated_car_parameters,
)

STATE_TOPIC = "/web_view/state"
"""What the page shows beside ROS's topics. Only clients of this node can subscribe to it."""

STATE_PERIOD = 1.0
"""Period at which the state is updated [s of wall-clock time]."""


class WebView:
    """The server as a node.

    Serves the page, and gives clients of rosbridge's protocol the topics and services of ROS. They
    can publish the topics of the page only: the start pose, clicked points, commands of teleop.

    Example: ``rosrun mushr_ros_intro web_view.py _port:=9090``
    """

    PARAMETERS = (
        node.car_name("the car to show"),
        node.init_pose_topic("topic of the initial pose"),
        text("address", "127.0.0.1", "of the network interface; 0.0.0.0 is all of them"),
        integer("port", 9090, 1, 65535, "port of the server"),
        text("hosts", None, "other names of this machine, separated by spaces"),
        text("token", None, "token for pages of other servers; by default a new one"),
        folder("folder", ".", "folder of your plans; . is the directory of your shell"),
    )

    def __init__(self, values: Values) -> None:
        self._car_name = values["car_name"]
        self._init_pose_topic = values["init_pose_topic"]
        self._address, self._port = values["address"], values["port"]
        self._hosts = (values["hosts"] or "").split()
        self._token = values["token"] or secrets.token_urlsafe()
        self._folders = [package_folder("plans"), values["folder"]]
        self._prefix = rospy.get_namespace().rstrip("/")
        self._seen: Dict[str, Any] = {}
        self._state = ""

    def run(self) -> None:
        """Serve until the node is shut down."""
        for name in ("asyncio", "tornado"):  # otherwise only log files have their errors
            logging.getLogger(name).addHandler(logging.StreamHandler())
            logging.getLogger(name).setLevel(logging.ERROR)
        asyncio.run(self._run())

    async def _run(self) -> None:
        ended, wake = asyncio.Event(), asyncio.Event()
        car, planner = f"/{self._car_name}", f"{self._prefix}/click_planner"
        teleop = f"{car}/mux/ackermann_cmd_mux/input/teleop"
        self._bridge = Bridge(
            {
                self._init_pose_topic: PoseWithCovarianceStamped,
                f"{self._prefix}/clicked_point": PointStamped,
                teleop: AckermannDriveStamped,
            },
            teleop,
            {
                *(f"{car}/car_sim/{name}" for name in ("reset", "pause", "resume", "step")),
                *(f"{planner}/{name}" for name in ("undo", "clear", "save")),
            },
            {STATE_TOPIC},
        )

        def end() -> None:
            ended.set()
            wake.set()

        rospy.on_shutdown(lambda: self._bridge.call_soon(end))
        # Otherwise a drive that starts elsewhere would be known up to a second later.
        self._bridge.listen(f"{car}/drive_monitor/start", lambda _: wake.set())
        program = os.path.join(os.path.dirname(os.path.abspath(__file__)), "path_publisher.py")
        offer = partial(self._bridge.call_soon, self._offer_state)
        self._drive = PlanDrive(program, self._prefix or "/", offer)
        self._map = WebMap(self._bridge, self._offer_state)
        server = serve(
            package_folder("web"),
            self._address,
            self._port,
            partial(refusal, hosts=self._hosts, secret=self._token),
            self._bridge,
            self._actions(),
        )
        rospy.loginfo(
            "open http://localhost:%d in a browser. Only pages of other servers need a token: %s",
            self._port,
            self._token,
        )
        while not ended.is_set():
            wake.clear()
            self._seen = await self._bridge.in_thread(self._look)
            self._offer_state()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(wake.wait(), STATE_PERIOD)
        server.stop()
        await self._bridge.in_thread(self._drive.end)

    def _actions(self) -> Dict[str, Dict[str, Action]]:
        """Return what the server answers, by path and method."""
        return {
            r"/map\.json": {"GET": self._map.get_numbers},
            r"/map\.png": {"GET": self._map.get_png},
            r"/plans/(.+)": {"GET": self._get_plan},
            r"/drive": {"POST": self._start_drive, "DELETE": self._stop_drive},
        }

    async def _get_plan(self, name: str) -> Dict[str, Any]:
        path = await self._path(name)
        return await self._bridge.in_thread(self._check, name, path)

    def _check(self, name: str, path: str) -> Dict[str, Any]:
        try:
            parameters = simulated_car_parameters(self._car_name, must_run=True)
        except OSError as error:
            raise UserError(rosapi.no_answer(error)) from None
        footprint = FOOTPRINTS[parameters.get(COLLISION)]
        return plans.describe(name, path, "car", car_from(parameters), self._map.grid, footprint)

    async def _path(self, name: Any) -> str:
        """Return the path of a plan; raise a LookupError if there is none with this name."""
        paths = await self._bridge.in_thread(plans.find_plans, self._folders)
        if not isinstance(name, str) or name not in paths:
            raise LookupError(f"there is no plan {name!r}; expected one of {', '.join(paths)}")
        return paths[name]

    async def _start_drive(self, body: Any) -> Dict[str, Any]:
        options = body if isinstance(body, dict) else {}
        name = options.get("plan")
        parameters = {
            "plan_file": await self._path(name),
            "loop": bool(options.get("loop")),
            "car_name": self._car_name,
            "init_pose_topic": self._init_pose_topic,
        }
        written = (await self._bridge.in_thread(plans.versions, self._folders)).get(name)
        await self._bridge.in_thread(self._drive.start, name, written, parameters)
        return {}

    async def _stop_drive(self) -> Dict[str, Any]:
        await self._bridge.in_thread(self._drive.stop)
        return {}

    def _look(self) -> Dict[str, Any]:
        """Return the part of the state that may change without a message; takes time."""
        car = f"/{self._car_name}/car_sim"
        seen = {
            "holds_clock": False,
            "has_car": False,
            "has_mux": False,
            **plans.car_limits(Parameters({})),
            **self._seen,
            "problem": "",
            "plans": plans.versions(self._folders),
        }
        try:
            services = rosapi.services()
            values = simulated_car_parameters(self._car_name, must_run=True)
            seen.update(plans.car_limits(values), holds_clock=f"{car}/pause" in services)
            seen["has_car"] = bool(values)
            self._drive.look(services, self._folders)
            active = f"/{self._car_name}/mux/ackermann_cmd_mux/active"
            seen["has_mux"] = any(map(is_alive, registered_nodes(active, "publishers")))
        except (CallError, OSError) as error:
            seen["problem"] = rosapi.no_answer(error)
        except UserError as error:
            seen["problem"] = str(error)
        return seen

    def _offer_state(self) -> None:
        """Send the state to the clients if it has changed."""
        if not self._seen:
            return
        state = {
            "car_name": self._car_name,
            "prefix": self._prefix,
            "initial_pose_topic": self._init_pose_topic,
            "map": self._map.number or None,
            "drive": self._drive.state,
            **self._seen,
        }
        message = json.dumps({"data": json.dumps(state)})
        if message != self._state:
            self._state = message
            self._bridge.offer(STATE_TOPIC, message)


if __name__ == "__main__":
    node.main("web_view", WebView, is_replaceable=False)
