"""Call the master or a node, by XML-RPC, with a timeout."""

import http.client
import socket
import xml.parsers.expat
import xmlrpc.client
from enum import Enum
from typing import Any

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
    try:
        server = xmlrpc.client.ServerProxy(uri, transport=_Transport(timeout))
        code, message, value = getattr(server, method)(caller, *arguments)
    except (socket.timeout, TimeoutError):
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


class _Transport(xmlrpc.client.Transport):
    """An XML-RPC connection with a timeout."""

    def __init__(self, timeout: float) -> None:
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """Return a connection to a host, with the timeout set."""
        connection = super().make_connection(host)
        connection.timeout = self._timeout
        return connection
