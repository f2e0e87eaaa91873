"""Measure the package on this machine; run by scripts/dev/benchmark.

All results are medians unless noted. They depend on the machine and its load, so compare only
results of the same run.
"""

import asyncio
import json
import os
import random
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
from contextlib import contextmanager, suppress

import laser_benchmark
import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from tornado.websocket import websocket_connect

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.preview.spread import Errors
from mushr_ros_intro.preview.spread import sample as sample_runs

CHECKOUT = os.path.abspath(os.path.join(os.path.dirname(__file__), "../.."))
sys.path.insert(0, os.path.join(CHECKOUT, "test"))
from support import classroom  # noqa: E402
from support.helpers import free_port  # noqa: E402

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
FUNCTIONS = ("drive_repeatedly", "cpu_and_memory", "latencies", "browser_view")
"""Those that `in_a_process` calls."""

RUNS = 20
CLIENTS = 4
"""Of the browser view."""

RIGHT_NODES = 10
"""Of a class, to measure the time of one replay."""

PLAN_SECONDS = 22.0
"""Of figure_8 [s]."""

LONG_SECONDS = 1000
"""Of a long plan, which shows the speed without the start and the end [s]."""


@contextmanager
def running(*command):
    """Run a command in the context; at the end, end all its processes."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        process.wait()


def wait_for_server(port):
    """Wait until a server accepts connections."""
    while True:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.05)


@contextmanager
def simulation(*arguments):
    """Run the car, the mux and a new master in the context."""
    port = free_port()
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
    launch = (
        "mushr_ros_intro",
        "sim.launch",
        "map:=none",
        "laser:=false",
        "model:=false",
        *arguments,
    )
    with running("roslaunch", "-p", str(port), *launch):
        while not rosgraph.is_master_online():
            time.sleep(0.05)
        yield


def in_a_process(function, *arguments):
    """Call `function` in a new process, because rospy starts only once; return its JSON output."""
    command = [sys.executable, os.path.abspath(__file__), function, *map(str, arguments)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def drive_repeatedly(plan, seconds, runs):
    """Drive a plan of `seconds` repeatedly; return the real-time factors and the final poses."""
    rospy.init_node("benchmark", disable_rostime=True, disable_signals=True)
    changed = threading.Condition()
    first, poses = [], []

    def on_command(msg):
        with changed:
            if not first:
                first.append((time.monotonic(), msg.header.stamp))

    def on_pose(msg):
        with changed:
            poses.append((time.monotonic(), msg))
            changed.notify_all()

    rospy.Subscriber(CONTROL, AckermannDriveStamped, on_command, tcp_nodelay=True)
    rospy.Subscriber("/car/car_pose", PoseStamped, on_pose, tcp_nodelay=True)
    factors, finals = [], []
    for _ in range(int(runs)):
        with changed:
            first.clear()
            poses.clear()
        node = ["rosrun", "mushr_ros_intro", "path_publisher.py", f"_plan_file:={plan}"]
        subprocess.run(node, check=True, stdout=subprocess.DEVNULL, timeout=120)
        with changed:
            began, stamp = first[0]
            end = stamp + rospy.Duration(float(seconds))
            ended, msg = next((wall, msg) for wall, msg in poses if msg.header.stamp >= end)
        factors.append(float(seconds) / (ended - began))
        position, turn = msg.pose.position, msg.pose.orientation
        finals.append((position.x, position.y, turn.z, turn.w))
    return {"factors": factors, "finals": finals}


def pid_of(name):
    """Return the process id of a node."""
    uri = rosgraph.Master("/benchmark").lookupNode(name)
    return xmlrpc.client.ServerProxy(uri).getPid("/benchmark")[2]


def used(pid):
    """Return the CPU time of a process [s]."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident(pid):
    """Return the resident memory of a process [MB]."""
    with open(f"/proc/{pid}/status") as file:
        return int(re.search(r"VmRSS:\s+(\d+)", file.read()).group(1)) / 1e3


def browser_view(port, seconds):
    """Measure the server of the browser view with clients that subscribe to what the page does.

    Return the times from the stamps of poses to their arrival at a client [s], and the server's CPU
    time per second [s] and resident memory [MB].
    """
    delays = []
    subscribed = {"car_pose": 15, "joint_states": 50, "odom": 100, "scan": 50, "driven_path": 200}

    async def read():
        client = await websocket_connect(f"ws://localhost:{port}/")
        for name, period in subscribed.items():
            request = {"op": "subscribe", "topic": f"/car/{name}", "throttle_rate": period}
            await client.write_message(json.dumps(request))
        while True:
            text, now = await client.read_message(), time.time()
            if "/car/car_pose" in text[:100]:
                stamp = json.loads(text)["msg"]["header"]["stamp"]
                delays.append(now - stamp["secs"] - stamp["nsecs"] / 1e9)

    async def meter():
        clients = [asyncio.ensure_future(read()) for _ in range(CLIENTS)]
        await asyncio.sleep(2.0)
        delays.clear()
        pid = pid_of("/web_view")
        before, began = used(pid), time.monotonic()
        await asyncio.sleep(float(seconds))
        cpu = (used(pid) - before) / (time.monotonic() - began)
        for client in clients:
            client.cancel()
        return {"delays": sorted(delays), "cpu": cpu, "memory": resident(pid)}

    return asyncio.run(meter())


def cpu_and_memory(seconds):
    """Return the CPU time per second [s] and the resident memory [MB] of the car and the mux."""
    rospy.init_node("benchmark", disable_signals=True)
    node = ["rosrun", "mushr_ros_intro", "path_publisher.py", "_plan_file:=figure_8"]
    rospy.Subscriber("/car/car_pose", PoseStamped)
    with subprocess.Popen(node, stdout=subprocess.DEVNULL) as publisher:
        rospy.wait_for_message(CONTROL, AckermannDriveStamped, timeout=30)
        pids = [pid_of(name) for name in ("/car/car_sim", "/car/mux/ackermann_cmd_mux")]
        before, began = [used(pid) for pid in pids], time.monotonic()
        time.sleep(float(seconds))
        elapsed = time.monotonic() - began
        after = [used(pid) for pid in pids]
        memory = [resident(pid) for pid in pids]
        publisher.terminate()
    return {"cpu": (sum(after) - sum(before)) / elapsed, "memory": sum(memory)}


def latencies(samples):
    """Return the times [s] from a command's publication to the odometry that shows it."""
    rospy.init_node("benchmark", disable_signals=True)
    seen = threading.Condition()
    latest = [0.0]

    def on_odometry(msg):
        with seen:
            latest[0] = msg.twist.twist.linear.x
            seen.notify_all()

    rospy.Subscriber("/car/odom", Odometry, on_odometry, tcp_nodelay=True)
    commands = rospy.Publisher(CONTROL, AckermannDriveStamped, queue_size=10, tcp_nodelay=True)
    while not commands.get_num_connections():
        time.sleep(0.01)
    dice = random.Random(1)
    found = []
    for sample in range(int(samples)):
        msg = AckermannDriveStamped()
        msg.header.stamp = rospy.Time.now()
        msg.drive.speed = 1.0 + (sample % 8) / 8.0  # exact as a float32
        with seen:
            began = time.monotonic()
            commands.publish(msg)
            if seen.wait_for(lambda speed=msg.drive.speed: latest[0] == speed, timeout=1.0):
                found.append(time.monotonic() - began)
        time.sleep(dice.uniform(0.08, 0.12))  # out of step with the poses
    return sorted(found)


def car_steps_per_second(plan, car, errors, cars):
    """Return how many commands of many cars are sampled per second of CPU time."""
    began = time.process_time()
    sample_runs(plan, car, errors, cars, 0)
    return cars * count_commands(plan) / (time.process_time() - began)


def grade_class(write):
    """Grade a class on three plans; `write` writes it to a folder; return the time [s]."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        write(os.path.join(folder, "class"))
        plans = ("figure_8", "circle", "straight_line")
        command = ("grade.py", f"{folder}/class", "--plans", *plans, "--out", f"{folder}/out")
        began = time.monotonic()
        subprocess.run(["rosrun", "mushr_ros_intro", *command], stdout=subprocess.DEVNULL)
        return time.monotonic() - began


def write_right_nodes(folder):
    """Write a class of RIGHT_NODES right nodes."""
    for number in range(RIGHT_NODES):
        classroom.write(folder, f"right_{number}", classroom.RIGHT)


def measure():
    """Yield (what, figure, unit)."""
    for load, busy in (("", 0), (", four busy loops beside it", 4)):
        loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
        try:
            with simulation("use_sim_time:=true", "real_time_factor:=0"):
                result = in_a_process("drive_repeatedly", "figure_8", PLAN_SECONDS, RUNS)
        finally:
            for loop in loops:
                loop.kill()
                loop.wait()
        factor = statistics.median(result["factors"])
        yield f"figure_8 in lock-step{load}, median of {RUNS}", factor, "times real time"
        spread = max(max(values) - min(values) for values in zip(*result["finals"]))
        yield f"largest spread of the final pose over these {RUNS} runs", spread, "m, rad"
    with tempfile.NamedTemporaryFile("w") as file, simulation(
        "use_sim_time:=true", "real_time_factor:=0"
    ):
        file.write("0, 0, 0\n" + "1.0, 0.1\n" * LONG_SECONDS)
        file.flush()
        result = in_a_process("drive_repeatedly", file.name, LONG_SECONDS, 3)
        factor = statistics.median(result["factors"])
        yield f"a plan of {LONG_SECONDS} s in lock-step, median of 3", factor, "times real time"
    with simulation():
        result = in_a_process("cpu_and_memory", 15)
        yield "CPU time of car and mux, poses at 50 Hz", result["cpu"], "s per s"
        yield "memory of car and mux together", result["memory"], "MB"
        found = in_a_process("latencies", 150)
        yield "from command to pose, p50", 1e3 * found[len(found) // 2], "ms"
        yield "from command to pose, p99", 1e3 * found[len(found) * 99 // 100], "ms"
    port = free_port()
    with simulation("map:=sandbox", "laser:=true", "web:=true", f"web_port:={port}"):
        wait_for_server(port)
        result = in_a_process("browser_view", port, 15)
        found = result["delays"]
        what = f"browser view, {CLIENTS} clients"
        yield f"{what}: from pose to client, p50", 1e3 * found[len(found) // 2], "ms"
        yield f"{what}: from pose to client, p99", 1e3 * found[len(found) * 99 // 100], "ms"
        yield f"{what}: CPU time", result["cpu"], "s per s"
        yield f"{what}: memory", result["memory"], "MB"
    yield "laser scans", laser_benchmark.scans_per_second(), "scans/s"
    plan = read_plan(os.path.join(CHECKOUT, "plans", "figure_8.txt"))
    nano = Car(speed_limit=0.929, acceleration=3.889, steering_rate=3.2)
    errors = Errors(speed=0.01, steering_angle=0.01)
    for name, car, cars in (
        ("ideal", Car(), 1000),
        ("ideal", Car(), 4096),
        ("limited", nano, 4096),
    ):
        rates = [car_steps_per_second(plan, car, errors, cars) for _ in range(9)]
        yield f"{cars} {name} cars with noise, median of 9", statistics.median(rates), "car-steps/s"
    seconds = grade_class(write_right_nodes) / (3 * RIGHT_NODES)
    yield "a replay of a right node, when a class is graded", seconds, "s"
    seconds = grade_class(lambda folder: classroom.write_class(folder, 100))
    yield "100 submissions of all kinds, three plans each", seconds, "s"
    began = time.monotonic()
    command = os.path.join(CHECKOUT, "scripts", "test")
    subprocess.run([command], stdout=subprocess.DEVNULL, check=True)
    yield "the whole test suite", time.monotonic() - began, "s"


def main():
    """Print the table, or the result of one measurement."""
    if len(sys.argv) > 1 and sys.argv[1] in FUNCTIONS:
        print(json.dumps(globals()[sys.argv[1]](*sys.argv[2:])))
        return
    as_json = "--json" in sys.argv
    rows = []
    for what, figure, unit in measure():
        rows.append({"what": what, "figure": figure, "unit": unit})
        if not as_json:
            print(f"{what:62s} {figure:12.6g} {unit}", flush=True)
    if as_json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
