"""Check the order, the rate and the number of the messages that a client gets."""

import asyncio
import functools
import time
import types

import pytest

from mushr_ros_intro.browser import outbox as outbox_module
from mushr_ros_intro.browser.outbox import (
    DEFAULT_QUEUE_LENGTH,
    MAX_QUEUE_LENGTH,
    MAX_REPLIES,
    Outbox,
)
from mushr_ros_intro.browser.protocol import Message, Request


def asynchronous(test):
    """Run a test in an event loop."""

    @functools.wraps(test)
    def run(*arguments, **named):
        asyncio.run(test(*arguments, **named))

    return run


def subscription(topic="/a", name=None, **options):
    return Request("subscribe", name, topic, **options)


def put(outbox, numbers, topic="/a"):
    for number in numbers:
        outbox.put(Message(topic, b"", lambda _, number=number: str(number), 0))


async def numbers_in(outbox):
    """Return the numbers of the messages that may be sent now."""
    numbers = []
    while True:
        try:
            frame = await asyncio.wait_for(outbox.next(), 0.01)
        except asyncio.TimeoutError:
            return numbers
        numbers.append(int(frame.split()[-1].rstrip("}")))


@pytest.mark.parametrize(
    ("lengths", "kept"),
    [([0], DEFAULT_QUEUE_LENGTH), ([1], 1), ([3, 5], 5), ([0, 3], 3), ([1e9], MAX_QUEUE_LENGTH)],
)
@asynchronous
async def test_a_client_that_does_not_read_keeps_the_newest_messages(lengths, kept):
    outbox = Outbox()
    for number, length in enumerate(lengths):
        outbox.subscribe(subscription(name=str(number), queue_length=length))
    put(outbox, range(2000))
    assert await numbers_in(outbox) == [*range(2000 - kept, 2000)]


@asynchronous
async def test_replies_come_first():
    outbox = Outbox()
    outbox.subscribe(subscription())
    put(outbox, [1])
    for number in range(MAX_REPLIES + 1):
        outbox.reply(str(number))
    assert await numbers_in(outbox) == [*range(1, MAX_REPLIES + 1), 1]


@asynchronous
async def test_only_messages_of_subscribed_topics_are_kept():
    outbox = Outbox()
    outbox.subscribe(subscription(name="x"))
    outbox.subscribe(subscription(name="y"))
    put(outbox, [1], "/b")
    assert not outbox.unsubscribe(Request("unsubscribe", "x", "/a"))
    put(outbox, [2])
    assert await numbers_in(outbox) == [2]
    assert outbox.unsubscribe(Request("unsubscribe", "y", "/a"))
    put(outbox, [3])
    outbox.subscribe(subscription(name="z"))
    assert outbox.unsubscribe(Request("unsubscribe", None, "/a"))
    put(outbox, [4])
    assert await numbers_in(outbox) == []
    assert not outbox.topics


@asynchronous
async def test_a_throttled_topic_delays_no_other(monkeypatch):
    now = [100.0]
    clock = types.SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr(outbox_module, "time", clock)
    outbox = Outbox()
    outbox.subscribe(subscription("/slow", throttle_rate=1000))
    outbox.subscribe(subscription("/slow", "x", throttle_rate=500))
    outbox.subscribe(subscription("/fast"))
    put(outbox, [1, 2], "/slow")
    assert await numbers_in(outbox) == [2]  # of a throttled topic, only the newest waits
    put(outbox, [3], "/slow")
    put(outbox, [4, 5], "/fast")
    assert await numbers_in(outbox) == [4, 5]
    now[0] += 0.49
    assert await numbers_in(outbox) == []
    put(outbox, [6], "/slow")
    now[0] += 0.02
    assert await numbers_in(outbox) == [6]


@asynchronous
async def test_waits_for_the_next_message():
    outbox = Outbox()
    outbox.subscribe(subscription(throttle_rate=20))
    put(outbox, [1])
    began = time.monotonic()  # the period begins in the next line
    await outbox.next()
    waiting = asyncio.ensure_future(outbox.next())
    put(outbox, [2])
    assert (await asyncio.wait_for(waiting, 60)).endswith("2}")
    assert time.monotonic() - began >= 0.02
    waiting = asyncio.ensure_future(outbox.next())
    await asyncio.sleep(0)
    outbox.reply("done")
    assert await asyncio.wait_for(waiting, 60) == "done"
