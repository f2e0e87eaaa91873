"""Check what clients get of topics that ROS does not have."""

import asyncio
import json

from mushr_ros_intro.browser.bridge import Bridge
from mushr_ros_intro.browser.outbox import Outbox


async def subscribe(bridge):
    """Return the outbox of a new client that subscribes to /state."""
    outbox = Outbox()
    await bridge.handle(outbox, json.dumps({"op": "subscribe", "topic": "/state"}))
    return outbox


def test_a_client_that_subscribes_before_the_first_message():
    """A page connects again as soon as a new server listens; later pages get the state, too."""

    async def run():
        bridge = Bridge({}, (), {"/state"})
        early = await subscribe(bridge)
        bridge.offer("/state", '{"data": 1}')
        for each in (early, await subscribe(bridge)):
            frame = await asyncio.wait_for(each.next(), 60.0)
            assert json.loads(frame)["msg"] == {"data": 1}

    asyncio.run(run())
