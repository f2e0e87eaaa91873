"""Hold the frames of a client until the client takes them.

A client that reads slowly loses old messages. No other client waits for it.
"""

import asyncio
import time
from collections import deque
from typing import Deque, Dict, Union

from mushr_ros_intro.browser.protocol import COMPRESSIONS, Id, Message, Request

DEFAULT_QUEUE_LENGTH = 20
"""How many messages of a topic wait for a client that sets no queue_length."""

MAX_QUEUE_LENGTH = 1000
"""How many messages of a topic wait at most, whatever the client asks for."""

MAX_REPLIES = 1000
"""How many replies and errors wait at most; the oldest are dropped."""

MAX_CALLS = 5
"""Calls of services by one client that run at the same time; further ones wait."""


class _Queue:
    """The messages of one topic that wait for a client."""

    def __init__(self) -> None:
        self.requests: Dict[Id, Request] = {}
        """The client's subscriptions to the topic, by their ids."""
        self.messages: Deque[Message] = deque()
        self.due = 0.0
        """When the first message may be sent [s of the monotonic clock]."""

    def update(self) -> None:
        """Apply the subscriptions; of several, the shortest period and the longest queue count.

        The client gets each message once.
        """
        requests = self.requests.values()
        self.period = min(request.throttle_rate for request in requests) / 1000.0
        lengths = [request.queue_length for request in requests if request.queue_length]
        default = 1 if self.period else DEFAULT_QUEUE_LENGTH
        length = int(min(max([1, *lengths] if lengths else [default]), MAX_QUEUE_LENGTH))
        self.messages = deque(self.messages, length)
        wanted = {request.compression for request in requests}
        self.compression = next(each for each in COMPRESSIONS if each in wanted)


class Outbox:
    """The frames of one client. All methods must be called in the thread of the event loop."""

    def __init__(self) -> None:
        self._replies: Deque[str] = deque(maxlen=MAX_REPLIES)
        self.topics: Dict[str, _Queue] = {}
        """The topics that the client subscribes to."""
        self._changed = asyncio.Event()
        self.running = asyncio.Semaphore(MAX_CALLS)

    def subscribe(self, request: Request) -> None:
        """Add a subscription, or replace the one with the same topic and id."""
        queue = self.topics.setdefault(request.topic, _Queue())
        queue.requests[request.id] = request
        queue.update()

    def unsubscribe(self, request: Request) -> bool:
        """Remove a subscription, or without an id all subscriptions, to a topic.

        Return whether no subscription to the topic is left.
        """
        queue = self.topics.get(request.topic, _Queue())
        if request.id is None:
            queue.requests.clear()
        queue.requests.pop(request.id, None)
        if queue.requests:
            queue.update()
            return False
        self.topics.pop(request.topic, None)
        return True

    def reply(self, frame: str) -> None:
        """Add a reply or an error; it is sent before all messages."""
        self._replies.append(frame)
        self._changed.set()

    def put(self, message: Message) -> None:
        """Add a message of a subscribed topic; if too many wait, the oldest is dropped."""
        queue = self.topics.get(message.topic)
        if queue is None:
            return
        if not queue.messages:
            queue.due = max(queue.due, time.monotonic())
        queue.messages.append(message)
        self._changed.set()

    async def next(self) -> Union[str, bytes]:
        """Wait for the next frame that may be sent, and return it."""
        while True:
            if self._replies:
                return self._replies.popleft()
            waiting = (queue for queue in self.topics.values() if queue.messages)
            first = min(waiting, key=lambda queue: queue.due, default=None)
            now = time.monotonic()
            if first and first.due <= now:
                first.due = now + first.period
                return first.messages.popleft().frame(first.compression)
            self._changed.clear()
            loop = asyncio.get_running_loop()
            timer = first and loop.call_later(first.due - now, self._changed.set)
            try:
                await self._changed.wait()
            finally:
                if timer:
                    timer.cancel()
