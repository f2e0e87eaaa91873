"""The browser view: start it, send requests to it, and connect clients to its bridge."""

import asyncio
import contextlib
import http.client
import json
import math
import os
from xmlrpc.client import ServerProxy

import roslib.packages
from tornado.websocket import websocket_connect

from support.geometry import ANGLE_TOLERANCE, POSITION_TOLERANCE, angle_between
from support.helpers import (
    PATIENCE,
    LoggedAssertionError,
    Process,
    free_port,
    master,
    node,
    wait_for,
)
from support.paths import CHECKOUT

CLIENTS = os.path.join(CHECKOUT, "build", ".clients")
"""Where `scripts/test --all` installs clients from npm and PyPI."""

INSTALL = "scripts/test --all installs what is missing"
"""The end of the reason why a test is skipped."""

JSON = {"Content-Type": "application/json"}
STATE = "/web_view/state"
POSE = "/car/car_pose"

_loop = asyncio.new_event_loop()


def complete(coroutine, what):
    """Run a coroutine to its end; return its result."""
    try:
        return _loop.run_until_complete(asyncio.wait_for(coroutine, PATIENCE))
    except asyncio.TimeoutError:
        raise LoggedAssertionError(f"waited {PATIENCE:g} s for {what}") from None


def upgrade(**headers):
    """Return the headers that ask for a connection to the bridge."""
    key = {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
    return {"Connection": "Upgrade", "Upgrade": "websocket", **key, **headers}


def fetch(port, path, method="GET", body=None, headers=None):
    """Return the status, the headers and the content of the answer to a request."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    with contextlib.closing(connection):
        connection.request(method, path, body, headers or {})
        answer = connection.getresponse()
        return answer.status, answer.headers, b"" if answer.status == 101 else answer.read()


def is_near(pose, other):
    """Return whether two (x, y, theta) agree as exactly as the package promises."""
    is_there = math.dist(pose[:2], other[:2]) < POSITION_TOLERANCE
    return is_there and angle_between(pose[2], other[2]) < ANGLE_TOLERANCE


class Client:
    """A client of the bridge. What it does not read, the server has to keep or to drop."""

    def __init__(self, port):
        async def connect():
            return await websocket_connect(f"ws://localhost:{port}/")

        self._socket = complete(connect(), "a connection")

    def send(self, op, **fields):
        self.send_text(json.dumps({"op": op, **fields}))

    def send_text(self, text):
        async def write():
            await self._socket.write_message(text, binary=isinstance(text, bytes))

        complete(write(), "the server to read")

    def frame(self, condition, what):
        """Return the next frame for which a condition is true, or None if the connection ends.

        Binary frames are skipped.
        """

        async def read():
            while True:
                text = await self._socket.read_message()
                if text is None:
                    return None
                frame = {} if isinstance(text, bytes) else json.loads(text)
                if frame and condition(frame):
                    return frame

        return complete(read(), what)

    def subscribe(self, topic, **options):
        self.send("subscribe", topic=topic, **options)

    def message(self, topic, condition=lambda _: True, what=""):
        """Return the next message of a topic for which a condition is true."""
        frame = self.frame(
            lambda frame: frame.get("topic") == topic and condition(frame["msg"]),
            f"a message on {topic} {what}",
        )
        if frame is None:
            raise LoggedAssertionError(f"no message on {topic} {what}: the connection has ended")
        return frame["msg"]

    def error(self):
        """Return the text of the next error."""
        return self.frame(lambda frame: frame["op"] == "status", "an error")["msg"]

    def call(self, service, args=()):
        """Call a service; return whether there is a result, and its values."""
        self.send("call_service", id=service, service=service, args=args)
        frame = self.frame(lambda frame: frame.get("id") == service, f"an answer of {service}")
        return frame["result"], frame["values"]

    def state(self, condition, what):
        """Wait for a state of the server; return it."""
        msg = self.message(STATE, lambda msg: condition(json.loads(msg["data"])), what)
        return json.loads(msg["data"])

    def stamps(self, count):
        """Return the stamps [ns] of the next poses."""
        stamps = (self.message(POSE)["header"]["stamp"] for _ in range(count))
        return [stamp["secs"] * 10**9 + stamp["nsecs"] for stamp in stamps]

    def close(self):
        self._socket.close()
        self.frame(lambda _: False, "the end of the connection")


class Simulation:
    """sim.launch with the browser view, on a master of its own.

    Args:
        folder: contains the user's plans.
        arguments: of sim.launch.
    """

    def __init__(self, folder, *arguments):
        self.port = free_port()
        self.url = f"http://localhost:{self.port}/"
        self._ending = contextlib.ExitStack()
        self.master, proxy = self._ending.enter_context(master("/web_test"))
        self.proxy = proxy
        self.environment = {"ROS_MASTER_URI": proxy.master_uri, "PWD": str(folder)}
        launch = ("sim.launch", "web:=true", f"web_port:={self.port}", *arguments)
        # roslaunch starts rosout only with a master of its own.
        rosout = Process(roslib.packages.find_node("rosout", "rosout")[0], **self.environment)
        self._ending.enter_context(rosout)
        try:
            self.launched = Process("roslaunch", "mushr_ros_intro", *launch, **self.environment)
            self._ending.callback(self._end)
            wait_for(self._answers, "the browser view")
            client = self.client(POSE)
            client.message(POSE)
            client.close()
        except BaseException:
            self.end()
            raise

    def _answers(self):
        with contextlib.suppress(OSError):
            return self.get("/map.json")[0] == 200

    def get(self, path, **headers):
        return fetch(self.port, path, headers=headers)

    def post(self, path, values):
        """Return the status and the JSON of the answer."""
        status, _, content = fetch(self.port, path, "POST", json.dumps(values), JSON)
        return status, json.loads(content)

    def delete(self, path):
        status, _, content = fetch(self.port, path, "DELETE")
        return status, json.loads(content)

    def client(self, *topics):
        """Return a new client with subscriptions."""
        client = Client(self.port)
        for topic in topics:
            client.subscribe(topic)
        return client

    def start(self, name, *arguments):
        """Start a node until the end of the simulation."""
        return self._ending.enter_context(node(name, *arguments, **self.environment))

    def pid(self, name):
        """Return the process id of a node."""
        with ServerProxy(self.proxy.lookupNode(name)) as server:
            return server.getPid("/web_test")[2]

    def _end(self):
        if self.launched.running:
            self.launched.send_signal(2)
            self.launched.wait()  # roslaunch ends its nodes, which have process groups of their own

    def end(self):
        self._ending.close()
