"""A registered node that never connects."""

import os
import threading

import rosgraph.xmlrpc


class Ghost:
    """A node that is registered at the master and never connects to other nodes.

    It answers a subscriber's request for a topic with a `port` of this machine, or refuses it. It
    has no method getBusInfo. With a `silence` [s], it has one, which waits for this time and then
    reports that the caller is connected.
    """

    def __init__(self, subscribes=(), publishes=(), port=None, silence=0.0, name="/ghost"):
        self.calls = {"publisherUpdate": [], "requestTopic": []}
        self._ended = threading.Event()
        self._silence = silence
        self._server = rosgraph.xmlrpc.ThreadingXMLRPCServer(("127.0.0.1", 0), log_requests=False)
        self._uri = f"http://localhost:{self._server.server_address[1]}/"
        self._master = rosgraph.Master(name)
        self._subscribes, self._publishes = subscribes, publishes
        self._server.register_function(lambda *_: (1, "", os.getpid()), "getPid")
        if silence:
            self._server.register_function(self._report_connected, "getBusInfo")
        offer = (1, "", ["TCPROS", "localhost", port]) if port else (0, "no", 0)
        for name, answer in (("publisherUpdate", (1, "", 0)), ("requestTopic", offer)):
            self._server.register_function(self._answer(name, answer), name)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        for topic in subscribes:
            self._master.registerSubscriber(topic, "*", self._uri)
        for topic in publishes:
            self._master.registerPublisher(topic, "*", self._uri)

    def _answer(self, name, answer):
        def take(_, *arguments):
            self.calls[name].append(list(arguments))
            return answer

        return take

    def _report_connected(self, caller):
        self._ended.wait(self._silence)
        return 1, "", [[1, caller, "o", "TCPROS", topic, True, ""] for topic in self._publishes]

    def suspend(self):
        """Stop to answer, as a node that is stopped with Ctrl-Z."""
        self._server.shutdown()

    def die(self):
        """End without unregistering."""
        self._ended.set()
        self._server.shutdown()
        self._server.server_close()

    def end(self):
        for topic in self._subscribes:
            self._master.unregisterSubscriber(topic, self._uri)
        for topic in self._publishes:
            self._master.unregisterPublisher(topic, self._uri)
        self.die()
