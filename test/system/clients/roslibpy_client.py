"""Use the bridge with roslibpy, and print what came as JSON: roslibpy_client.py PORT X Y."""

import json
import queue
import sys

import roslibpy

PATIENCE = 60.0
"""[s]"""

port, x, y = sys.argv[1], *map(float, sys.argv[2:])
ros = roslibpy.Ros("localhost", int(port))
ros.run(PATIENCE)
errors = queue.Queue()


def collect_errors(protocol):
    """Collect errors. roslibpy only logs that it does not expect them."""
    protocol._message_handlers["status"] = lambda message: errors.put(message["msg"])


ros.factory.on_ready(collect_errors)


class Received:
    """The first message for which a condition is true."""

    def __init__(self, name, kind, condition=lambda _: True):
        self._messages = queue.Queue()
        self._condition = condition
        self._topic = roslibpy.Topic(ros, name, kind)
        self._topic.subscribe(self._messages.put)

    def get(self):
        while True:
            msg = self._messages.get(timeout=PATIENCE)
            if self._condition(msg):
                self._topic.unsubscribe()
                return msg


def publish(name, kind, message):
    roslibpy.Topic(ros, name, kind).publish(roslibpy.Message(message))


def called(name):
    service = roslibpy.Service(ros, name, "std_srvs/Trigger")
    return dict(service.call(roslibpy.ServiceRequest(), timeout=PATIENCE))


def of_car(msg):
    frames = msg["transforms"]
    return next((each for each in frames if each["child_frame_id"] == "car/base_footprint"), None)


found = {}
pose, grid, scan, tf = (
    each.get()
    for each in (
        Received("/car/car_pose", "geometry_msgs/PoseStamped"),
        Received("/map", "nav_msgs/OccupancyGrid"),
        Received("/car/scan", "sensor_msgs/LaserScan"),
        Received("/tf", "tf2_msgs/TFMessage", of_car),
    )
)
found["pose"] = pose["header"]["frame_id"]
found["map"] = [grid["info"]["width"], grid["info"]["height"], len(grid["data"])]
found["scan"] = len(scan["ranges"])
found["tf"] = of_car(tf)["header"]["frame_id"]
found["topics"] = "/car/car_pose" in ros.get_topics()

PATH = "/click_planner/path"


def is_start(stamped):
    position = stamped["pose"]["position"]
    return (position["x"], position["y"]) == (x, y)


placed = Received("/car/car_pose", "geometry_msgs/PoseStamped", is_start)
begun = Received(PATH, "nav_msgs/Path", lambda msg: msg["poses"] and is_start(msg["poses"][0]))
start = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": {"w": 1.0}}
publish(
    "/initialpose",
    "geometry_msgs/PoseWithCovarianceStamped",
    {"header": {"frame_id": "map"}, "pose": {"pose": start}},
)
found["placed"] = placed.get()["pose"]["position"]
begun.get()
drawn = Received(PATH, "nav_msgs/Path", lambda m: len(m["poses"]) > 1 and is_start(m["poses"][0]))
publish(
    "/clicked_point",
    "geometry_msgs/PointStamped",
    {"header": {"frame_id": "map"}, "point": {"x": x + 1.0, "y": y, "z": 0.0}},
)
found["clicked"] = drawn.get()["poses"][-1]["pose"]["position"]["x"]
nodes, answers = ros.get_nodes(), queue.Queue()
for each in nodes:  # all at once
    ros.get_node_details(each, lambda _, each=each: answers.put(each))
found["nodes"] = [answers.get(timeout=PATIENCE) for _ in nodes]
found["param"] = roslibpy.Param(ros, "/car/car_sim/pose_rate").get()
found["undo"], found["undoAgain"] = called("/click_planner/undo"), called("/click_planner/undo")
try:
    found["service"] = called("/car/car_sim/explode")
except Exception as error:
    found["service"] = str(error)

publish("/car/car_pose", "geometry_msgs/PoseStamped", dict(pose))
publish("/clicked_point", "geometry_msgs/PointStamped", {"place": [1, 2]})
roslibpy.Topic(ros, "/car/scan", "std_msgs/String").subscribe(lambda _: None)
found["errors"] = [errors.get(timeout=PATIENCE) for _ in range(4)]
print(json.dumps(found), flush=True)
ros.terminate()
