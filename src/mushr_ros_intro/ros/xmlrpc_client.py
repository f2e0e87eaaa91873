"""Call the master or a node, by XML-RPC, with a timeout."""

import errno
import http.client
import socket
import xml.parsers.expat
import xmlrpc.client
from enum import Enum
from typing import Any

from mushr_ros_intro.stamps import CALL_TIMEOUT

DEFAULT_MASTER = "http://localhost:11311"
"""The address of the master if ROS_MASTER_URI is not set."""


class CallFault(Enum):
    """Why a call to the master or to a node failed; the text is for a call to the master."""

    MALFORMED = f"expected is an address such as {DEFAULT_MASTER}"
    UNKNOWN_HOST = "its host name cannot be resolved"
    REFUSED = "no master runs there"
    NO_RESPONSE = "the master there does not respond"
    NOT_ROS = "the program there is not a ROS master"


class CallError(RuntimeError):
    """A call to the master or to a node failed."""

    def __init__(self, message: str, fault: CallFault = CallFault.REFUSED) -> None:
        super().__init__(message)
        self.fault = fault


def ask(uri: str, timeout: float, caller: str, method: str, *arguments: Any) -> Any:
    """Call a method of the master or of a node, and return its value.

    Args:
        uri: the address of the master or the node.
        timeout: for connecting and for each read [s].
        caller: the name of the calling node.
        method: a method of the Master API or the Slave API of ROS.
        arguments: the method's arguments after the caller's name.

    Raises:
        CallError: the call failed. If the other side answers with an error, it has replaced the one
            that was called.
    """
    transport = LimitedTransport()
    transport.timeout = timeout
    try:
        server = xmlrpc.client.ServerProxy(uri, transport=transport)
        code, message, value = getattr(server, method)(caller, *arguments)
    except TimeoutError:
        raise CallError(f"{uri}: no response within {timeout:g} s", CallFault.NO_RESPONSE) from None
    except socket.gaierror:
        raise CallError(f"{uri}: unknown host", CallFault.UNKNOWN_HOST) from None
    except OSError as error:
        is_refused = isinstance(error, ConnectionError)  # otherwise the host cannot be reached
        fault = CallFault.REFUSED if is_refused else CallFault.NO_RESPONSE
        raise CallError(f"{uri}: {error}", fault) from None
    except (
        xmlrpc.client.Error,
        xml.parsers.expat.ExpatError,
        http.client.HTTPException,
        TypeError,
        ValueError,
    ):
        raise CallError(f"{uri}: not a ROS master or node", CallFault.NOT_ROS) from None
    if code != 1:
        raise CallError(str(message))
    return value


class LimitedTransport(xmlrpc.client.Transport):
    """An XML-RPC connection with a timeout; see rospy_fixes.limit_calls."""

    timeout = CALL_TIMEOUT
    """For connecting and for each read [s]."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """Return a connection to a host, with the timeout set."""
        connection = super().make_connection(host)
        connection.timeout = self.timeout
        return connection

    def single_request(self, *arguments: Any, **options: Any) -> Any:
        """Send a request, and return the answer."""
        try:
            return super().single_request(*arguments, **options)
        except socket.timeout:  # has no errno, but rospy reads errno when a node unregisters
            raise OSError(errno.ETIMEDOUT, f"no answer within {self.timeout:g} s") from None
