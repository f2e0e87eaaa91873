"""Decide which programs and pages may use the server.

Any page that a browser shows can send requests to a server on the same machine. The browser adds
the header Origin, which names the page's server. The header Host contains the host name in the
address of the request. A page can switch its own host name to this machine (DNS rebinding). Then
Host contains that name, which is not a name of this server.
"""

import hmac
from typing import Collection, Optional
from urllib.parse import urlsplit

LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")


def refusal(
    host: Optional[str],
    origin: Optional[str],
    token: Optional[str],
    hosts: Collection[str],
    secret: str,
) -> str:
    """Return why a request is refused; empty if it is allowed.

    Args:
        host: the header Host.
        origin: the header Origin; programs that are not browsers send none.
        token: the parameter token of the address.
        hosts: other names of this server than those of the local machine.
        secret: the token that any other page needs.
    """
    name = _host_name(host)
    if name not in (*LOCAL_HOSTS, *map(str.lower, hosts)):  # a URL has it in lower case
        return f"the host {name!r} is not a name of this server; expected one of its ~hosts"
    if origin in (None, f"http://{host}"):
        return ""
    if token is not None and hmac.compare_digest(token.encode(), secret.encode()):
        return ""
    return f"pages of {origin!r} may not use this server; expected its token"


def _host_name(host: Optional[str]) -> str:
    try:
        return urlsplit(f"//{host or ''}").hostname or ""
    except ValueError:
        return ""
