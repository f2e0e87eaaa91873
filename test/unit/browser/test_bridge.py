"""Check what the bridge does for clients, without ROS."""

import asyncio
import json
from types import SimpleNamespace

import pytest
import rospy
from ackermann_msgs.msg import AckermannDriveStamped

from mushr_ros_intro.browser import rosapi
from mushr_ros_intro.browser.bridge import SILENCE, Bridge, SharedTopic
from mushr_ros_intro.browser.outbox import MAX_CALLS, Outbox
from mushr_ros_intro.browser.protocol import Message, Request
from mushr_ros_intro.ros.xmlrpc_client import CallError


async def subscribe(bridge):
    """Return the outbox of a new client that subscribes to /state."""
    outbox = Outbox()
    await bridge.handle(outbox, json.dumps({"op": "subscribe", "topic": "/state"}))
    return outbox


def test_a_client_that_subscribes_before_the_first_message():
    """A page connects again as soon as a new server listens; later pages get the state, too."""

    async def run():
        bridge = Bridge({}, "", (), {"/state"})
        early = await subscribe(bridge)
        bridge.offer("/state", '{"data": 1}')
        for each in (early, await subscribe(bridge)):
            frame = await asyncio.wait_for(each.next(), 60.0)
            assert json.loads(frame)["msg"] == {"data": 1}

    asyncio.run(run())


def test_latched_messages_of_publishers_that_have_ended():
    """A later client gets the messages of live publishers only."""

    async def run():
        ended, alive = ({"latching": "1", "callerid": name} for name in ("/ended", "/alive"))
        topic, outbox, later = SharedTopic("/text"), Outbox(), Outbox()
        topic.outboxes.add(outbox)
        for each in (outbox, later):
            each.subscribe(Request("subscribe", topic="/text"))
        for header in (ended, alive):
            topic.put(Message("/text", header["callerid"].encode(), str, 0), header)
        connections = [SimpleNamespace(header=alive)]
        topic.subscriber = SimpleNamespace(impl=SimpleNamespace(connections=connections))
        topic.put_latched(later)
        (frame,) = (each.frame("none") for each in later.topics["/text"].messages)
        assert "/alive" in frame and len(outbox.topics["/text"].messages) == 2

    asyncio.run(run())


class Publisher:
    """Keep what is published."""

    data_class = AckermannDriveStamped

    def __init__(self):
        self.speeds = []
        self.is_stopped = asyncio.Event()

    def publish(self, msg):
        self.speeds.append(msg.drive.speed)
        if not msg.drive.speed:
            self.is_stopped.set()


def test_a_client_that_falls_silent(monkeypatch):
    """Each command, and one stop after the last one; no second stop after that of the client."""
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(1))

    async def run(*speeds):
        publisher = Publisher()
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: publisher)
        bridge = Bridge({"/drive": AckermannDriveStamped}, "/drive", (), ())
        for speed in speeds:
            frame = {"op": "publish", "topic": "/drive", "msg": {"drive": {"speed": speed}}}
            await bridge.handle(Outbox(), json.dumps(frame))
        await asyncio.wait_for(publisher.is_stopped.wait(), 60.0)
        await asyncio.sleep(3 * SILENCE)
        return publisher.speeds

    assert asyncio.run(run(1.0, 2.0)) == [1.0, 2.0, 0.0]
    assert asyncio.run(run(1.0, 0.0)) == [1.0, 0.0]


def test_calls_wait_for_each_other(monkeypatch):
    """A client that asks all at once gets all answers, and no more than MAX_CALLS run."""
    running, most = set(), []

    async def in_thread(self, function, service, _):
        running.add(service)
        most.append(len(running))
        await asyncio.sleep(0.0)
        running.discard(service)
        return service

    monkeypatch.setattr(Bridge, "in_thread", in_thread)

    async def run():
        bridge, outbox = Bridge({}, "", (), ()), Outbox()
        names = [f"/{number}" for number in range(30)]
        for name in names:
            await bridge.handle(outbox, json.dumps({"op": "call_service", "service": name}))
        frames = [json.loads(await asyncio.wait_for(outbox.next(), 60.0)) for _ in names]
        assert {each["values"] for each in frames} == {*names}
        assert all(each["result"] for each in frames) and max(most) == MAX_CALLS

    asyncio.run(run())


def test_a_parameter_without_a_master(monkeypatch):
    def refuse(_):
        raise ConnectionRefusedError(111, "Connection refused")

    monkeypatch.setattr(rospy, "get_param", refuse)
    with pytest.raises(CallError, match="the ROS master does not answer"):
        rosapi.call("/rosapi/get_param", {"name": "/x"})
