"""Check the server of the browser view with real clients, foreign pages, and bad clients."""

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess

import numpy as np
import pytest
from PIL import Image

from support import web
from support.helpers import Process, free_port, kill, node, wait_for
from support.messages import MUX, TELEOP

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "clients")

CELLS = 1000
"""Of a side of the map sandbox."""


@pytest.fixture(scope="module")
def sim(tmp_path_factory):
    """Yield a simulation whose user has one plan."""
    folder = tmp_path_factory.mktemp("plans")
    (folder / "long.txt").write_text("0, 0, 0\n0.5, 0.1, 100.0\n")
    found = web.Simulation(folder, "model:=false")
    found.folder = folder
    yield found
    found.end()


def version_of_node():
    """Return the major version of Node.js; 0 without Node.js."""
    if not shutil.which("node"):
        return 0
    return int(subprocess.check_output(["node", "--version"], text=True)[1:].split(".")[0])


def roslib(number, file, minimum):
    """Return the command of a client with roslib, and the version of Node.js that it needs."""
    module = f"{web.CLIENTS}/node_modules/roslib{number}/{file}"
    return (["node", f"{FOLDER}/roslib_client.mjs", module, "ws://localhost:{port}"], minimum)


PROGRAMS = {
    "roslib 1": roslib(1, "src/RosLib.js", 14),
    "roslib 2": roslib(2, "dist/RosLib.js", 18),
    "roslibpy": ([f"{web.CLIENTS}/bin/python", f"{FOLDER}/roslibpy_client.py", "{port}"], 0),
}


@pytest.mark.full
@pytest.mark.parametrize("name", PROGRAMS)
def test_real_client(sim, name):
    command, minimum = PROGRAMS[name]
    if not os.path.exists(f"{web.CLIENTS}/pins"):
        pytest.skip(f"{name} is not installed; {web.INSTALL}")
    if version_of_node() < minimum:
        pytest.skip(f"{name} needs Node.js {minimum}")
    x, y = 1.5 + list(PROGRAMS).index(name), -0.1
    words = [*(word.format(port=sim.port) for word in command), repr(x), repr(y)]
    # The packages of the system are not those that the client needs.
    with Process(*words, PYTHONPATH="") as process:
        status = process.wait()
    assert status == 0, process.output
    found = json.loads(process.output.splitlines()[-1])
    assert found["pose"] == "map" and found["tf"] == "car/odom", found
    assert found["map"] == [CELLS, CELLS, CELLS**2]
    assert found["scan"] == 720 and found["topics"] is True
    assert (found["placed"]["x"], found["placed"]["y"]) == (x, y)
    assert abs(found["clicked"] - x - 1.0) < 1e-6, "the plan does not end at the click"
    assert found["undo"]["success"] is True and found["undo"]["message"]
    assert "/car/car_sim" in found["nodes"], "nodes whose details came, asked for all at once"
    assert found["param"] == 50.0
    assert found["undoAgain"] == {"success": False, "message": "there is no click to undo"}
    assert "may not call '/car/car_sim/explode'" in found["service"]
    errors = "\n".join(sorted(found["errors"]))
    assert errors.count("may not publish on '/car/car_pose'") == 2, "advertise and publish"
    assert "not a geometry_msgs/PointStamped" in errors
    assert "type of /car/scan is 'std_msgs/String'; expected 'sensor_msgs/LaserScan'" in errors


SAME = "http://localhost:{port}"
WHO = [
    # Host, Origin, parameters, status of a connection, which of the second server
    ("localhost:{port}", SAME, "", 101, 101),
    ("localhost:{port}", "http://evil.example", "?token=secret", 403, 101),
    ("car.example:{port}", "http://car.example:{port}", "", 403, 101),
    ("evil.example:{port}", "http://evil.example:{port}", "", 403, 403),  # DNS rebinding
]
"""test/unit/browser/test_access.py has more."""


@pytest.fixture(scope="module")
def other_port(sim):
    """Run another server, with a token and another name."""
    port = free_port()
    settings = ("_token:=secret", "_hosts:=car.example")
    name = ("__name:=other_view", f"_port:={port}")
    with node("web_view.py", *name, *settings, **sim.environment) as process:
        wait_for(lambda: "in a browser" in process.output, "the other server")
        yield port


def test_who_may_use_it(sim, other_port):
    for server, port in enumerate((sim.port, other_port)):
        for host, origin, parameters, *statuses in WHO:
            headers = {"Host": host.format(port=port), "Origin": origin.format(port=port)}
            case = f"server {server}, {headers} {parameters}"
            got, answer, content = web.fetch(port, f"/{parameters}", headers=web.upgrade(**headers))
            assert got == statuses[server], f"a connection: {case}"
            is_json = answer.get("Content-Type", "").startswith("application/json")
            assert got == 101 or (b'{"error": "' in content and is_json), case
            got, _, _ = web.fetch(port, f"/plans/circle{parameters}", headers=headers)
            assert got == {101: 200, 403: 403}[statuses[server]], f"a plan: {case}"


def test_listens_on_loopback_only(other_port):
    addresses = []
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        with open(table) as file:
            addresses += [line.split()[1] for line in file.readlines()[1:] if " 0A " in line]
    found = [each for each in addresses if int(each.split(":")[1], 16) == other_port]
    assert found == [f"0100007F:{other_port:04X}"]


def test_a_port_that_is_taken(sim):
    name = ("__name:=third_view", f"_port:={sim.port}")
    with node("web_view.py", *name, **sim.environment) as process:
        assert process.wait() == 1
    assert process.output.count("[FATAL]") == 1 and "Traceback" not in process.output
    assert f"port {sim.port} of 127.0.0.1 cannot be used" in process.output


def test_a_car_that_is_killed(sim):
    """The state says so, also of its mux, and its parameters do not change the prediction."""
    port = free_port()
    car = node("car_sim.py", "__ns:=/car9", "_speed_limit:=0.25", **sim.environment)
    sim.proxy.setParam("/car9/mux/ackermann_cmd_mux", sim.proxy.getParam(MUX))
    mux = node("ackermann_cmd_mux.py", "__ns:=/car9/mux", **sim.environment)
    settings = ("__name:=fourth_view", f"_port:={port}", "_car_name:=car9")
    with car, mux, node("web_view.py", *settings, **sim.environment) as process:
        wait_for(lambda: "in a browser" in process.output, "the other server")
        client = web.Client(port)
        client.subscribe(web.STATE)
        client.state(lambda state: state["has_car"] and state["has_mux"], "with a car and its mux")
        assert web.fetch(port, "/plans/figure_8")[2] != sim.get("/plans/figure_8")[2]
        for name in ("/car9/car_sim", "/car9/mux/ackermann_cmd_mux"):
            kill(name, sim.pid(name), sim.environment["ROS_MASTER_URI"])
        client.state(lambda state: not (state["has_car"] or state["has_mux"]), "without both")
        assert web.fetch(port, "/plans/figure_8")[2] == sim.get("/plans/figure_8")[2]
        client.close()


def test_headers(sim):
    paths = ("/", "/main.js", "/icon.svg", "/map.json", "/map.png", "/nothing", "/plans/nothing")
    assert 'href="icon.svg"' in sim.get("/")[2].decode(), "browsers ask for /favicon.ico"
    for path in paths:
        status, headers, _ = sim.get(path)
        assert status == (404 if "nothing" in path else 200), path
        policy = headers["Content-Security-Policy"]
        assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy, path
        assert headers["X-Content-Type-Options"] == "nosniff", path
        assert headers.get_all("Access-Control-Allow-Origin") is None, path


OUTSIDE = ["../package.xml", "%2e%2e/package.xml", "%2fetc%2fpasswd", "..\\package.xml"]


def test_files_outside_are_not_shown(sim):
    for path in OUTSIDE:
        for base in ("/", "/plans/"):
            status, _, content = sim.get(base + path)
            assert status in (400, 404), base + path
            assert b"<name>" not in content and b"root:" not in content, base + path


def test_plans_are_known_by_name_only(sim):
    (sim.folder / "outside").mkdir()
    path = sim.folder / "outside" / "plan.txt"
    path.write_text("0, 0, 0\n1.0, 0.0\n")
    names = [str(path), "outside/plan", "./long", "../plans/figure_8", "long.txt"]
    for name in [*names, None, ["long"]]:
        status, answer = sim.post("/drive", {"plan": name})
        assert status == 404 and "there is no plan" in answer["error"], name
    assert sim.post("/drive", {"plan": "50%d"})[1]["error"].startswith("there is no plan '50%d';")
    for values in ([], "long", 3, None):
        assert sim.post("/drive", values)[0] in (400, 404), values
    for name in names[1:]:
        assert sim.get(f"/plans/{name}")[0] == 404, name
    assert json.loads(sim.get("/plans/long")[2])["duration"] == 100.0
    client = sim.client(web.STATE)
    assert client.state(lambda _: True, "at once")["drive"] is None
    client.close()


def test_a_plan_that_is_written_and_deleted(sim):
    client = sim.client(web.STATE)
    state = client.state(lambda state: True, "at once")
    assert {"long", "figure_8"} <= set(state["plans"]) and "new" not in state["plans"]
    assert state["hand"] == {"speed": 2.0, "steering_angle": 0.34}, "those of the ideal car"
    path = sim.folder / "new.txt"
    path.write_text("0, 0, 0\n1.0, 0.0\n")
    first = client.state(lambda state: "new" in state["plans"], "with the plan")["plans"]["new"]
    os.utime(path, (0, 0))
    client.state(lambda state: state["plans"].get("new") not in (None, first), "that has changed")
    path.unlink()
    client.state(lambda state: "new" not in state["plans"], "without the plan")
    client.close()


def test_one_drive_at_a_time(sim):
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    body = json.dumps({"plan": "long"})
    assert web.fetch(sim.port, "/drive", "POST", body, form)[0] == 415, "any page can send a form"
    headers = {"Content-Type": "application/json"}
    status, _, answer = web.fetch(sim.port, "/drive", "POST", "{", headers)
    expected = "the body is not JSON: Expecting property name"
    assert status == 400 and json.loads(answer)["error"].startswith(expected)
    assert sim.delete("/drive") == (409, {"error": "no plan is being driven"})
    client = sim.client(web.STATE, "/car/mux/ackermann_cmd_mux/output")
    sim.proxy.setParam("/path_publisher/of_an_earlier_run", 1)
    assert sim.post("/drive", {"plan": "long"}) == (200, {})
    client.message(
        "/car/mux/ackermann_cmd_mux/output", lambda msg: msg["drive"]["speed"] == 0.5, "that drives"
    )
    status, answer = sim.post("/drive", {"plan": "circle"})
    assert status == 409 and "long is being driven" in answer["error"]
    assert sim.delete("/drive") == (200, {})
    ended = client.state(lambda state: state["drive"] and not state["drive"]["running"], "an end")
    assert ended["drive"]["plan"] == "long"
    assert ended["drive"]["stopped"] is True, "a stop is not an error of the plan"
    wait_for(lambda: "ended in line 2" in sim.launched.output, "the end of the output")
    assert "earlier" not in sim.launched.output
    client.close()
    client = sim.client("/car/odom")
    client.message("/car/odom", lambda m: m["twist"]["twist"]["linear"]["x"] == 0.0, "that stands")
    client.close()


BAD = [
    ("[" * 20_000, "not JSON"),
    ('{"op": "publish", "topic": "/clicked_point", "msg": {"where": 1}}', "PointStamped"),
    (f'{{"op": "publish", "topic": "{TELEOP}", "msg": {{"drive": {{"speed": 1e99}}}}}}', "large"),
    ('{"op": "publish", "topic": "/car/car_pose", "msg": {}}', "may not publish"),
    ('{"op": "advertise", "topic": "/tf", "type": "tf2_msgs/TFMessage"}', "may not publish"),
    ('{"op": "advertise", "topic": "/initialpose", "type": "std_msgs/String"}', "type of"),
    ('{"op": "subscribe", "topic": "not a name"}', "not a name"),
    ('{"op": "subscribe", "topic": "/new", "type": "evil; import os"}', "evil; import os"),
]
"""test/unit/browser/test_protocol.py and test_messages.py have more."""

REFUSED_CALLS = [
    ("/static_map", {}, "may not call"),
    ("/car/car_sim/reset", {"x": 1}, "expected none"),
    ("/rosapi/set_param", {"name": "/x", "value": "1"}, "not offered"),
    ("/rosapi/topics", {"x": 1}, "arguments"),
    ("/rosapi/node_details", {"node": 1}, "arguments"),
]


def test_requests_that_are_refused(sim):
    client, watcher = sim.client(), sim.client(web.POSE)
    before = watcher.message(web.POSE)["pose"]
    for text, part in BAD:
        client.send_text(text)
        error = client.error()
        assert part in error and len(error) < 1000, (text[:100], error)
    for service, args, part in REFUSED_CALLS:
        result, values = client.call(service, args)
        assert result is False and part in values, service
    assert client.call("/rosapi/topics")[0] is True, "the connection is as good as before"
    stamps = watcher.stamps(2)
    assert stamps[1] > stamps[0] and watcher.message(web.POSE)["pose"] == before
    client.close()
    watcher.close()


def test_what_foxglove_asks_for(sim):
    client = sim.client()
    _, found = client.call("/rosapi/topics_and_raw_types")
    number = found["topics"].index(web.POSE)
    assert found["types"][number] == "geometry_msgs/PoseStamped"
    assert "MSG: geometry_msgs/Pose\n" in found["typedefs_full_text"][number]
    assert "/car/car_sim" in client.call("/rosapi/nodes")[1]["nodes"]
    _, details = client.call("/rosapi/node_details", {"node": "/car/car_sim"})
    assert web.POSE in details["publishing"]
    assert "/initialpose" in details["subscribing"]
    assert "/car/car_sim/reset" in details["services"]
    assert client.call("/rosapi/node_details", ["/car/car_sim"]) == (True, details), "a list"
    pose_rate = {"name": "/car/car_sim/pose_rate"}
    for args in (pose_rate, {**pose_rate, "default": "1"}, [pose_rate["name"]]):
        assert client.call("/rosapi/get_param", args) == (True, {"value": "50.0"}), args
    assert client.call("/rosapi/get_param", {"name": "/no"}) == (True, {"value": "null"})
    unlimited = {"name": "/car/car_sim/speed_limit"}  # JSON has no infinity
    assert client.call("/rosapi/get_param", unlimited) == (True, {"value": "null"})
    assert client.call("/rosapi/get_param", ["/no", "1"]) == (True, {"value": "1"})
    assert pose_rate["name"] in client.call("/rosapi/get_param_names")[1]["names"]
    client.close()


def test_each_subscription_gets_the_latched_message(sim):
    client = sim.client("/map_metadata")
    first = client.message("/map_metadata")
    client.subscribe("/map_metadata", id="second")
    assert client.message("/map_metadata") == first
    client.close()


def test_a_long_frame(sim):
    client = sim.client(web.POSE)
    client.message(web.POSE)
    with contextlib.suppress(Exception):  # the connection may end while the frame is sent
        client.send_text(" " * 2_000_000)
    assert client.frame(lambda _: False, "the end of the connection") is None
    sim.client().close()


@pytest.mark.full
def test_twenty_clients_of_which_some_do_not_read(sim):
    mapped = sim.client("/map")
    mapped.message("/map")  # from now on, the server has the map
    silent, reader = sim.client(web.POSE), sim.client(web.POSE)
    # tornado receives two frames that nobody reads: poses, so that the maps stay in the connection.
    silent.stamps(1)
    reader.stamps(5)
    for _ in range(8):  # these maps are larger than what the connection takes
        silent.subscribe("/map", id="a")
        reader.call("/rosapi/get_time")  # answered after the server has begun to send the map
        silent.send("unsubscribe", topic="/map", id="a")
    slow = sim.client(web.POSE, "/car/scan")
    clients = [sim.client() for _ in range(18)]
    for client in clients:
        client.subscribe(web.POSE, queue_length=1000)  # the server may stand for some time
    found = [client.stamps(10) for client in clients]
    for _ in range(30):
        slow.message(web.POSE)
        for client, stamps in zip(clients, found):
            stamps += client.stamps(3)
    sent = sorted({stamp for stamps in found for stamp in stamps})
    for stamps in found:
        first, last = (sent.index(stamp) for stamp in (stamps[0], stamps[-1]))
        assert stamps == sent[first : last + 1], "a client that reads has lost poses"
    kept = silent.stamps(1)
    while kept[-1] < found[0][-1]:
        kept += silent.stamps(1)
    lost = set(found[0]) - set(kept)
    assert len(lost) > 20, "the server keeps all poses for a client that does not read"
    for client in (mapped, silent, reader, slow, *clients):
        client.close()


@pytest.mark.full
def test_a_master_that_does_not_answer(sim):
    client, watcher = sim.client(web.STATE), sim.client(web.POSE)
    client.state(lambda state: not state["problem"], "without a problem")
    watcher.message(web.POSE)
    os.kill(sim.master.pid, signal.SIGSTOP)
    try:
        client.subscribe("/tf")
        state = client.state(lambda state: state["problem"], "with a problem")
        assert "the ROS master does not answer" in state["problem"]
        assert state["has_car"], "the master does not say that it is gone"
        result, values = client.call("/rosapi/topics")
        assert result is False and isinstance(values, str)
        watcher.stamps(100)
        assert sim.get("/map.json")[0] == 200
        status, _, content = sim.get("/plans/figure_8")
        assert status == 409 and b"the ROS master does not answer" in content
        status, answer = sim.post("/drive", {"plan": "long"})
        assert status == 409 and "the ROS master does not answer" in answer["error"]
    finally:
        os.kill(sim.master.pid, signal.SIGCONT)
    client.state(lambda state: not state["problem"], "without a problem")
    assert client.call("/rosapi/topics")[0] is True
    client.close()
    watcher.close()


def test_another_map(sim):
    """The last test, because the other map stays."""
    client = sim.client(web.STATE)
    number = client.state(lambda state: state["map"], "a map")["map"]
    with node("map_server.py", "_map_file:=rooms", **sim.environment):
        # There may be no map for a moment: the other server replaces the first one.
        client.state(lambda state: state["map"] not in (None, number), "another map")
        client.subscribe("/map")
        msg = client.message("/map", lambda msg: msg["info"]["width"] != CELLS, "of rooms")
        values = json.loads(sim.get("/map.json")[2])
        picture = Image.open(io.BytesIO(sim.get(f"/map.png?{values['number']}")[2]))
    client.close()
    info = msg["info"]
    assert (values["width"], values["height"]) == (info["width"], info["height"]) == picture.size
    assert values["origin"] == [-14.5, -10.5, 0.0] and values["resolution"] == 0.05
    cells = np.array(msg["data"]).reshape(info["height"], info["width"])[::-1]
    grey = np.select([cells == 100, cells == 0], [0, 254], 205)
    assert np.array_equal(np.asarray(picture), grey) and len(np.unique(grey)) > 1
