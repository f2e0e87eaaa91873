"""Host names and addresses of this machine, and calls that end in time."""

import os
import socket
import threading
import time
from contextlib import suppress
from typing import Any, Callable, List, Sequence

import rosgraph.network

from mushr_ros_intro.doctor.facts import Finding
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault

_RESOLVE_TIMEOUT = 2.0
"""For looking up a host name [s]."""


def run_in_parallel(jobs: Sequence[Callable[[], Any]], timeout: float) -> List[Any]:
    """Run functions in daemon threads.

    Returns:
        What each returned or raised; a CallError for each that is not done in time [s].
    """
    late = CallError(f"no response within {timeout:g} s", CallFault.NO_RESPONSE)
    results: List[Any] = [late for _ in jobs]

    def run(index: int) -> None:
        try:
            results[index] = jobs[index]()
        except Exception as error:
            results[index] = error

    threads = [threading.Thread(target=run, args=(each,), daemon=True) for each in range(len(jobs))]
    deadline = time.monotonic() + timeout
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    return list(results)


def run_with_timeout(job: Callable[[], Any], timeout: float) -> Any:
    """Run a function in a daemon thread, and return or raise what it does.

    Raises:
        CallError: it is not done within `timeout` [s].
    """
    (result,) = run_in_parallel([job], timeout)
    if isinstance(result, Exception):
        raise result
    return result


def resolve(host: str) -> List[str]:
    """Return the IP addresses of a host; none if it cannot be resolved in time."""
    with suppress(OSError, UnicodeError, CallError):
        found = run_with_timeout(lambda: socket.getaddrinfo(host, 0), _RESOLVE_TIMEOUT)
        return [str(each[4][0]) for each in found]
    return []


def is_local(addresses: Sequence[str]) -> bool:
    """Return whether all IP addresses, at least one, are addresses of this machine."""
    here = [*rosgraph.network.get_local_addresses(), "::1"]
    return bool(addresses) and all(each in here or each.startswith("127.") for each in addresses)


def address_towards(host: str) -> str:
    """Return the address of this machine in the network of a host; "" if there is no way to it."""
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as connection:
        connection.connect((host, 9))  # sends nothing
        return str(connection.getsockname()[0])
    return ""


def advertised_findings(uri: str) -> List[Finding]:
    """Return that nodes of this machine advertise a name which the master's machine cannot reach.

    Args:
        uri: the address of the master.
    """
    try:
        host, _ = rosgraph.network.parse_http_host_and_port(uri)
    except ValueError:
        return []
    addresses = resolve(host)
    name = rosgraph.network.get_host_name()  # from ROS_HOSTNAME, ROS_IP, or the machine's own
    if not addresses or is_local(addresses) or not all(map(_is_loopback, resolve(name))):
        return []
    address = address_towards(host) or "THE_ADDRESS_OF_THIS_MACHINE"
    return [
        Finding(
            f"the master is on another machine, {host}, which cannot reach the nodes of this "
            f"machine: they advertise the name '{name}'",
            f"In every terminal here, type: unset ROS_HOSTNAME; export ROS_IP={address}, and start "
            "the nodes again",
        )
    ]


def _is_loopback(address: str) -> bool:
    return address.startswith("127.") or address == "::1"


def network_findings() -> List[Finding]:
    """Return what is wrong with ROS_HOSTNAME, or else with ROS_IP, on this machine."""
    variable = "ROS_HOSTNAME" if "ROS_HOSTNAME" in os.environ else "ROS_IP"
    host = os.environ.get(variable)
    if host is None or is_local(addresses := resolve(host)):
        return []
    problem = f"{variable} is '{host}', which cannot be resolved"
    if addresses:
        problem = f"{variable} is '{host}', which is not an address of this machine"
    return [
        Finding(
            problem,
            "Set it to this machine's address in every terminal. If all nodes run on this "
            "machine, type: unset ROS_IP; export ROS_HOSTNAME=localhost",
        )
    ]
