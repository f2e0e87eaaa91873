"""The HTTP server: the page, its data, and the connections of rosbridge's clients."""

import asyncio
import json
from typing import Any, Awaitable, Callable, Dict, Optional, Union

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from mushr_ros_intro.browser.bridge import Bridge
from mushr_ros_intro.browser.outbox import Outbox
from mushr_ros_intro.browser.protocol import status
from mushr_ros_intro.errors import UserError

MAX_FRAME = 100_000
"""The longest frame of a client [bytes]; after a longer one, the connection is closed."""

PING_PERIOD = 10.0
"""A client that does not answer for three periods is disconnected [s]."""

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


Answer = Union[Dict[str, Any], bytes]
"""JSON, or a PNG image."""

Action = Callable[..., Awaitable[Answer]]
"""Answers a request. Its arguments are the groups of the path, and for POST the JSON of the body.

It raises LookupError if there is no such resource, and UserError if it cannot be answered now.
"""


def serve(
    folder: str,
    address: str,
    port: int,
    refusal: Callable[[Optional[str], Optional[str], Optional[str]], str],
    bridge: Bridge,
    actions: Dict[str, Dict[str, Action]],
) -> HTTPServer:
    """Start the server in the event loop of this thread.

    Args:
        folder: contains the files of the page.
        address: of the network interface.
        port: of the server.
        refusal: see `access.refusal`, of which it gets the first three arguments.
        bridge: for rosbridge's clients, which connect to /.
        actions: for each path, a regular expression, the action of each method (GET, POST, DELETE).

    Raises:
        UserError: the port cannot be used.
    """
    routes = [(path, _ActionHandler, {"actions": methods}) for path, methods in actions.items()]
    application = Application(
        [
            ("/", _Root, {"bridge": bridge, "folder": folder}),
            *routes,
            (r"/([\w-]+\.(?:js|css|svg))", _File, {"path": folder}),
        ],
        default_handler_class=_ActionHandler,
        default_handler_args={"actions": {}},
        refusal=refusal,
        websocket_max_message_size=MAX_FRAME,
        websocket_ping_interval=PING_PERIOD,
        log_function=lambda handler: None,
    )
    server = HTTPServer(
        application, max_body_size=MAX_FRAME, max_header_size=16_384, idle_connection_timeout=60.0
    )
    try:
        server.listen(port, address)
    except (OSError, OverflowError) as error:
        raise UserError(
            f"port {port} of {address} cannot be used ({error}); a rosbridge, such as that of "
            "MuSHR's installation, uses port 9090. Expected a free port, such as "
            f"web_port:={port + 1} of the car's launch file, or port:={port + 1} of web.launch"
        ) from None
    return server


class _Handler(RequestHandler):
    """A handler that checks who sends the request."""

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        headers, token = self.request.headers, self.get_query_argument("token", None)
        reason = self.settings["refusal"](headers.get("Host"), headers.get("Origin"), token)
        if reason:
            raise HTTPError(403, reason=None, log_message=reason)

    def write_error(self, status_code: int, **arguments: Any) -> None:
        _, error, _ = arguments.get("exc_info", (None, None, None))
        text = self._reason
        if isinstance(error, HTTPError) and error.log_message:
            text = error.log_message % error.args
        self.finish({"error": text})


class _File(_Handler, StaticFileHandler):
    """A file of the page."""


class _ActionHandler(_Handler):
    """Data for the page, and its actions."""

    def initialize(self, actions: Dict[str, Action]) -> None:
        self._actions = actions

    async def get(self, *groups: str) -> None:
        await self._act("GET", *groups)

    async def delete(self, *groups: str) -> None:
        await self._act("DELETE", *groups)

    async def post(self, *groups: str) -> None:
        # A page of another server can send a form, but not JSON.
        if self.request.headers.get("Content-Type", "").split(";")[0] != "application/json":
            raise HTTPError(415, "expected Content-Type: application/json")
        try:
            body = json.loads(self.request.body)
        except (ValueError, RecursionError) as error:
            raise HTTPError(400, "the body is not JSON: %s", error) from None
        await self._act("POST", *groups, body)

    async def _act(self, method: str, *arguments: Any) -> None:
        if not self._actions:
            raise HTTPError(404, f"there is no {self.request.path}")
        if method not in self._actions:
            raise HTTPError(405)
        try:
            answer = await self._actions[method](*arguments)
        except LookupError as error:
            raise HTTPError(404, str(error.args[0])) from None
        except UserError as error:
            raise HTTPError(409, str(error)) from None
        if isinstance(answer, bytes):
            self.set_header("Content-Type", "image/png")
        self.finish(answer)


class _Root(_Handler, WebSocketHandler):
    """The page, or with a request to upgrade the connection, a client of rosbridge."""

    def initialize(self, bridge: Bridge, folder: str) -> None:
        self._bridge = bridge
        self._folder = folder

    async def get(self) -> None:
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await super().get()
        else:
            with open(f"{self._folder}/index.html", encoding="utf-8") as file:
                self.finish(file.read())

    def check_origin(self, origin: str) -> bool:
        return True  # see `prepare`

    def open(self, *args: str, **kwargs: str) -> None:
        self.set_nodelay(True)
        self._outbox = Outbox()
        self._sender = asyncio.ensure_future(self._send(self._outbox))

    async def on_message(self, frame: Union[str, bytes]) -> None:
        await self._bridge.handle(self._outbox, frame)

    async def _send(self, outbox: Outbox) -> None:
        """Send frames while the client reads them."""
        while True:
            try:
                frame = await outbox.next()
                await self.write_message(frame, binary=isinstance(frame, bytes))
            except WebSocketClosedError:
                break
            except ValueError as error:  # a message cannot be decoded
                outbox.reply(status(str(error), None))

    def on_close(self) -> None:
        self._sender.cancel()
        self._bridge.disconnect(self._outbox)
