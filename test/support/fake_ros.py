"""Run a node's callbacks without a master."""

import genpy
import rospy

PARAMETERS = {
    "~plan_file": "circle",
    "~active_topic": "active",
    "~": {
        "publisher": "output",
        "subscribers": [
            {"name": name, "topic": name, "timeout": 0.2, "priority": priority}
            for priority, name in enumerate("ab")
        ],
    },
}


class Ros:
    """What a node needs of rospy, without a master: its messages come from the test."""

    def __init__(self, monkeypatch):
        self.now = 10**18
        self.inputs = []
        self.published = []
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy, "Publisher", self._advertise)
        monkeypatch.setattr(rospy, "Service", lambda *_: None)
        monkeypatch.setattr(rospy, "get_param", lambda name, *usual: PARAMETERS.get(name, *usual))
        monkeypatch.setattr(rospy, "get_rostime", lambda: genpy.Time(0, self.now))
        monkeypatch.setattr(rospy, "get_namespace", lambda: "/car/")
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/car/{name}")
        for name in ("loginfo", "logwarn", "logwarn_throttle"):
            monkeypatch.setattr(rospy, name, lambda *_: None)

    def _subscribe(self, topic, kind, callback, *arguments, **_):
        self.inputs.append((topic, kind, callback, arguments))
        return self._end(topic)

    def _advertise(self, topic, _, **__):
        return self._end(topic)

    def _end(self, topic):
        """Return a subscriber or publisher, which is connected with somebody."""
        end = type("End", (), {"resolved_name": f"/car/{topic}"})()
        end.get_num_connections = lambda: 1
        # As rospy does, a message of one field may be given as its field.
        end.publish = lambda msg: self.published.extend(msg if isinstance(msg, list) else [msg])
        return end
