"""Connect rosbridge's clients with ROS.

The methods of `Bridge` run in the thread of its event loop. Calls that may take time run in other
threads.
"""

import asyncio
import io
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Any, Callable, Collection, Dict, List, Mapping, Optional, Set, Tuple, Union

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from rospy.msg import AnyMsg
from std_srvs.srv import Trigger

from mushr_ros_intro.browser import messages, rosapi
from mushr_ros_intro.browser.outbox import Outbox
from mushr_ros_intro.browser.protocol import (
    Message,
    ProtocolError,
    Request,
    read_request,
    response,
    status,
)
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.ros.conversions import MessageError
from mushr_ros_intro.ros.xmlrpc_client import CallError
from mushr_ros_intro.stamps import CALL_TIMEOUT

SILENCE = 0.2
"""Longest time between two commands of clients [s]; the mux takes a command for that long, too."""

THREADS = 16
"""The number of calls that run at the same time."""


_Header = Mapping[str, str]


class SharedTopic:
    """A topic that clients and this program subscribe to; they share one subscription in ROS."""

    def __init__(self, name: str, is_local: bool = False) -> None:
        self.name = name
        self.is_local = is_local
        """Whether only this program publishes it, and only to its clients."""
        self.outboxes: Set[Outbox] = set()
        self.listeners: List[Callable[[bytes], None]] = []
        self._latched: Dict[str, Tuple[_Header, Message]] = {}
        """The last message of each publisher that latches, by the publisher's name."""
        self.decoders: Dict[str, Callable[[bytes], str]] = {}
        """By message type: publishers of one topic may have different types."""
        self.subscriber: Optional[rospy.Subscriber] = None

    @property
    def is_used(self) -> bool:
        """Whether a client or this program needs the topic."""
        return self.is_local or bool(self.outboxes or self.listeners)

    def put(self, message: Message, header: _Header) -> None:
        """Send a message to all clients, and if it is latched, keep it for later clients.

        Args:
            message: the message.
            header: of the connection over which the message came.
        """
        if header.get("latching") == "1":
            self._latched[header.get("callerid", "")] = header, message
        for outbox in self.outboxes:
            outbox.put(message)

    def put_latched(self, outbox: Outbox) -> None:
        """Send a new client the latched messages, except those of publishers that have ended."""
        if self.subscriber:
            headers = [connection.header for connection in self.subscriber.impl.connections]
            self._latched = {
                name: (header, message)
                for name, (header, message) in self._latched.items()
                if any(header is each for each in headers)
            }
        for _, message in self._latched.values():
            outbox.put(message)


def _report(done: "Future[None]") -> None:
    """Log the error of a subscription in ROS."""
    if done.exception():
        rospy.logerr("a topic cannot be subscribed to: %s", done.exception())


class Bridge:
    """The topics and services of ROS, for clients.

    If no client sends the next command on `driving` in time, the car gets a stop: a page can fall
    silent while it drives, and not every mux stops the car then.

    Args:
        publishable: the topics on which clients may publish, with their message classes.
        driving: that of them which drives the car, of ackermann_msgs/AckermannDriveStamped.
        services: the names of the std_srvs/Trigger services that clients may call.
        local: the names of the topics that ROS does not have, for `offer`. Clients may subscribe to
            them before the first message.
    """

    def __init__(
        self,
        publishable: Mapping[str, Any],
        driving: str,
        services: Collection[str],
        local: Collection[str],
    ) -> None:
        self._publishers = {
            name: rospy.Publisher(name, kind, queue_size=10, tcp_nodelay=True)
            for name, kind in publishable.items()
        }
        self._driving = driving
        self._stop: Optional[asyncio.TimerHandle] = None
        self._services = services
        self._topics = {name: SharedTopic(name, is_local=True) for name in local}
        self._loop = asyncio.get_event_loop()
        self._registration = ThreadPoolExecutor(1)
        self._pool = ThreadPoolExecutor(THREADS)

    def listen(self, name: str, listener: Callable[[bytes], None]) -> None:
        """Call a function with every message of a topic, as ROS transmits it."""
        topic = self._topics.setdefault(name, SharedTopic(name))
        topic.listeners.append(listener)
        self._update(topic)

    def offer(self, name: str, text: str) -> None:
        """Publish JSON text to the clients, on a local topic."""
        message = Message(name, b"", lambda _: text, 0)
        self._topics[name].put(message, {"latching": "1"})

    async def handle(self, outbox: Outbox, frame: Union[str, bytes]) -> None:
        """Carry out the request in a frame of a client; errors are sent to the client."""
        request = Request("")
        try:
            request = read_request(frame)
            await self._carry_out(outbox, request)
        except (ProtocolError, MessageError, CallError) as error:
            outbox.reply(status(str(error), request.id))

    def disconnect(self, outbox: Outbox) -> None:
        """Remove all subscriptions of a client."""
        for name in [*outbox.topics]:
            self._unsubscribe(outbox, Request("unsubscribe", topic=name))

    async def in_thread(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a function returns that may take time."""
        return await self._loop.run_in_executor(self._pool, function, *arguments)

    def call_soon(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call a function in the event loop, from any thread; do nothing if the loop has ended."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(function, *arguments)

    async def _carry_out(self, outbox: Outbox, request: Request) -> None:
        """Carry out a request.

        Raises:
            ProtocolError, MessageError: it is not allowed, or wrong.
            CallError: the master does not answer.
        """
        if request.op == "subscribe":
            await self._subscribe(outbox, request)
        elif request.op == "unsubscribe":
            self._unsubscribe(outbox, request)
        elif request.op == "advertise":
            expected = self._publisher(request.topic).data_class._type
            if request.type.replace("/msg/", "/") != expected:
                raise ProtocolError(
                    f"type of {request.topic} is {request.type!r}; expected {expected!r}"
                )
        elif request.op == "publish":
            self._publish(request)
        elif request.op == "call_service":
            asyncio.ensure_future(self._answer(outbox, request))

    def _publish(self, request: Request) -> None:
        publisher = self._publisher(request.topic)
        msg = messages.from_values(publisher.data_class, request.msg)
        publisher.publish(msg)
        if request.topic == self._driving:
            self._stop_after(msg)

    def _stop_after(self, command: AckermannDriveStamped) -> None:
        """Send a stop if no other command follows this one in time."""
        if self._stop:
            self._stop.cancel()
        stop = Request("publish", topic=self._driving)
        is_stop = not (command.drive.speed or command.drive.steering_angle)
        self._stop = None if is_stop else self._loop.call_later(SILENCE, self._publish, stop)

    def _publisher(self, topic: str) -> rospy.Publisher:
        if topic not in self._publishers:
            allowed = ", ".join(self._publishers)
            raise ProtocolError(f"clients may not publish on {topic!r}; expected one of {allowed}")
        return self._publishers[topic]

    async def _subscribe(self, outbox: Outbox, request: Request) -> None:
        name = request.topic
        if not self._topics.get(name, SharedTopic(name)).is_local:
            if not name.isascii() or not rosgraph.names.is_legal_name(name) or name == "/":
                raise ProtocolError(f"topic is {name!r}; expected a name such as /car/car_pose")
            known = (await self.in_thread(rosapi.topic_types)).get(name, "*")
            asked = request.type.replace("/msg/", "/") or known
            if asked != "*":
                messages.message_class(asked)
            if known not in ("*", asked):
                raise ProtocolError(f"type of {name} is {asked!r}; expected {known!r}")
        topic = self._topics.setdefault(name, SharedTopic(name))
        topic.outboxes.add(outbox)
        outbox.subscribe(request)
        topic.put_latched(outbox)
        self._update(topic)

    def _unsubscribe(self, outbox: Outbox, request: Request) -> None:
        """Remove a subscription of a client, or all of its subscriptions to a topic."""
        topic = self._topics.get(request.topic)
        if outbox.unsubscribe(request) and topic:
            topic.outboxes.discard(outbox)
            self._update(topic)

    def _update(self, topic: SharedTopic) -> None:
        """Subscribe to a topic in ROS if it is used, and end the subscription if it is not."""
        if not topic.is_used:
            self._topics.pop(topic.name, None)
        if not topic.is_local:
            self._registration.submit(self._register, topic).add_done_callback(_report)

    def _register(self, topic: SharedTopic) -> None:
        """Carry out what `_update` decides. In a thread, because the master may answer late."""
        if topic.is_used and topic.subscriber is None:
            topic.subscriber = rospy.Subscriber(
                topic.name, AnyMsg, self._on_message, topic, tcp_nodelay=True
            )
        elif not topic.is_used and topic.subscriber is not None:
            topic.subscriber.unregister()
            topic.subscriber = None

    def _on_message(self, msg: rospy.Message, topic: SharedTopic) -> None:
        if isinstance(msg, AnyMsg):
            raw = msg._buff
        else:  # rospy itself subscribes to /clock, and has decoded the message
            buffer = io.BytesIO()
            msg.serialize(buffer)
            raw = buffer.getvalue()
        self.call_soon(self._deliver, topic, raw, msg._connection_header, ros_time.now())

    def _deliver(self, topic: SharedTopic, raw: bytes, header: _Header, now: int) -> None:
        kind = header["type"]
        if kind not in topic.decoders:
            topic.decoders[kind] = messages.decoder(kind)
        topic.put(Message(topic.name, raw, topic.decoders[kind], now), header)
        for listener in topic.listeners:
            listener(raw)

    async def _answer(self, outbox: Outbox, request: Request) -> None:
        try:
            async with outbox.running:
                call = self.in_thread(self._call, request.service, request.args)
                reply = response(request, await asyncio.wait_for(call, 2 * CALL_TIMEOUT))
        except asyncio.TimeoutError:
            text = f"{request.service} does not respond within {2 * CALL_TIMEOUT:g} s"
            reply = response(request, text, result=False)
        except (ProtocolError, MessageError, CallError, rospy.ServiceException) as error:
            reply = response(request, str(error), result=False)
        outbox.reply(reply)

    def _call(self, service: str, args: Union[Dict[str, Any], List[Any]]) -> Any:
        service = f"/{service.lstrip('/')}"  # roslib 2 calls rosapi/topics
        if service.startswith(rosapi.PREFIX):
            return rosapi.call(service, args)
        if service not in self._services:
            allowed = ", ".join(sorted(self._services))
            raise ProtocolError(
                f"clients may not call {service!r}; expected one of {allowed}, or of rosapi"
            )
        if args:
            raise ProtocolError(f"arguments of {service} are {args}; expected none")
        return messages.to_values(rospy.ServiceProxy(service, Trigger).call())
