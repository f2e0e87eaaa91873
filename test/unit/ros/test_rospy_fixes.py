"""Write messages to a subscriber that reads all, some time later, or never."""

import socket
import struct
import threading
import time
from contextlib import suppress
from functools import partial
from types import SimpleNamespace

import pytest
import rospy
from rospy.exceptions import TransportException
from rospy.impl.masterslave import ROSHandler
from rospy.impl.tcpros_base import TCPROSTransport, TCPROSTransportProtocol
from rospy.impl.tcpros_pubsub import TCPROSHandler
from std_msgs.msg import String

from mushr_ros_intro.ros.rospy_fixes import (
    DirectConnection,
    connect_once,
    publish_together,
)
from support.helpers import wait_for


@pytest.fixture
def ends():
    """Return a connection without a limit of its queue, and the socket of its subscriber."""
    yield from connect(0)


@pytest.fixture
def limited():
    """Return the same with a queue of one message."""
    yield from connect(1)


def connect(queue_size):
    ours, theirs = socket.socketpair()
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    transport = TCPROSTransport(TCPROSTransportProtocol("/topic", None), "/topic")
    transport.set_socket(ours, "/subscriber")
    connection = DirectConnection(transport, queue_size)
    yield connection, theirs
    theirs.close()
    transport.close()
    ours.close()
    connection._thread.join(10)
    assert not connection._thread.is_alive()


def message(number, size):
    return struct.pack("<II", size + 4, number) + bytes(size)


def receive(end, count=None, last=None):
    """Return the numbers of the messages that are received, until a count or a number."""
    numbers = []
    end.settimeout(10)
    with end.makefile("rb") as stream:
        while len(numbers) != count and (not numbers or numbers[-1] != last):
            size, number = struct.unpack("<II", stream.read(8))
            assert stream.read(size - 4) == bytes(size - 4)
            numbers.append(number)
    return numbers


def test_a_message_is_written_by_the_thread_that_publishes_it(ends):
    connection, theirs = ends
    for number in range(3):
        before = connection.stat_bytes
        connection.write_data(message(number, 10))
        assert (connection.stat_num_msg, connection.stat_bytes) == (number + 1, before + 18)
    assert receive(theirs, 3) == [0, 1, 2]


@pytest.mark.parametrize("size", [1, 1000, 5000, 100_000])
def test_all_messages_arrive_in_order(ends, size):
    """Some are written at once, some in part, and the others by the thread of the connection."""
    connection, theirs = ends
    writer = threading.Thread(
        target=lambda: [connection.write_data(message(number, size)) for number in range(200)]
    )
    writer.start()
    assert receive(theirs, 200) == list(range(200))
    writer.join()
    wait_for(lambda: connection.stat_num_msg == 200, "the counter")
    connection.write_data(message(7, 10))  # at once again
    assert connection.stat_num_msg == 201


@pytest.mark.parametrize("size", [1000, 5000, 100_000])
def test_a_subscriber_that_does_not_read_delays_nobody(limited, size):
    """A queue of one message keeps the newest one, and no message is cut."""
    connection, theirs = limited
    began = time.monotonic()
    for number in range(1000):
        connection.write_data(message(number, size))
    assert time.monotonic() - began < 10  # it would be for ever
    numbers = receive(theirs, last=999)
    assert numbers == sorted(set(numbers)) and len(numbers) < 1000
    wait_for(lambda: connection.stat_num_msg == len(numbers), "the counter")
    connection.write_data(message(7, 10))  # at once again
    assert connection.stat_num_msg == len(numbers) + 1


def test_the_error_of_a_subscriber_that_has_ended(ends):
    connection, theirs = ends
    theirs.close()

    def fails():
        try:
            return not connection.write_data(message(0, 10))
        except (TransportException, OSError):
            return True

    wait_for(fails, "the error")


def test_messages_that_are_published_together_are_one_packet(ends, monkeypatch):
    connection, _ = ends
    sent = []

    def send(data, flags):
        sent.append((data, bool(flags & socket.MSG_MORE)))
        return len(data)

    monkeypatch.setattr(connection._connection, "socket", SimpleNamespace(send=send))
    implementation = SimpleNamespace(connections=[connection])
    publisher = SimpleNamespace(impl=implementation, publish=connection.write_data)
    for _ in range(2):
        publish_together(publisher, [b"one", b"two", b"three"])
        connection.write_data(b"alone")
    assert sent == 2 * [(b"one", True), (b"two", True), (b"three", False), (b"alone", False)]


def test_a_publisher_that_is_reported_twice_is_connected_once(monkeypatch):
    """Two threads see that there is no connection yet; without the lock, they do so twice."""
    both, added = threading.Barrier(2), []

    def has_connection(_):
        found = bool(added)
        with suppress(threading.BrokenBarrierError):
            both.wait(1.0)
        return found

    subscriber = SimpleNamespace(
        has_connection=has_connection,
        add_connection=added.append,
        data_class=String,
        queue_size=None,
        buff_size=65536,
        tcp_nodelay=False,
        receive_callback=None,
    )
    manager = SimpleNamespace(get_subscriber_impl=lambda topic: subscriber)
    answer = 1, "", ["TCPROS", "localhost", 1]
    publisher = SimpleNamespace(requestTopic=lambda *_: answer)
    for module in (rospy.impl.masterslave, rospy.impl.registration):
        monkeypatch.setattr(module, "get_topic_manager", lambda: manager)
    monkeypatch.setattr(rospy.impl.masterslave, "xmlrpcapi", lambda *_, **__: publisher)
    monkeypatch.setattr(TCPROSHandler, "create_transport", TCPROSHandler.create_transport)
    connect_once()
    handler = SimpleNamespace(protocol_handlers=[TCPROSHandler()])
    connect = partial(ROSHandler._connect_topic, handler, "/topic", "http://publisher:1")
    threads = [threading.Thread(target=connect) for _ in range(2)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert len(added) == 1
