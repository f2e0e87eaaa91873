"""A class of nodes in many styles, right and wrong, composed of parts.

Each node is the template with some parts replaced. `python3 styles.py FOLDER` writes the class.
"""

import os
import sys
import textwrap

TEMPLATE = """\
#!/usr/bin/python3
import asyncio, datetime, math, os, queue, select, signal, subprocess, sys, threading, time
import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_msgs.msg import Float64, Header

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
{imports}

def place(x, y, theta):
    msg = PoseWithCovarianceStamped()
    msg.header = Header(stamp=rospy.Time.now(), frame_id="map")
    msg.pose.pose.position.x = x
    msg.pose.pose.position.y = y
    msg.pose.pose.orientation.z = math.sin(theta / 2.0)
    msg.pose.pose.orientation.w = math.cos(theta / 2.0)
    poses.publish(msg)

def send(v, delta, stamp=None):
    msg = AckermannDriveStamped()
    {stamp}
    msg.drive.speed = v
    msg.drive.steering_angle = delta
    commands.publish(msg)

def read():
    with open(rospy.get_param("~plan_file")) as file:
        rows = [[float(each) for each in line.split(",")] for line in file if line.strip()]
    return rows[0], [(v, delta, (more or [1.0])[0]) for v, delta, *more in rows[1:]]

{functions}
rospy.init_node("path_publisher")
{publishers}
start, rows = read()
{rows}
{connect}
{start}
{warm_up}
{drive}
{stop}
{end}
"""

PARTS = {
    "imports": "",
    "functions": "",
    "stamp": "msg.header.stamp = stamp or rospy.Time.now()",
    "publishers": """
        commands = rospy.Publisher(CONTROL, AckermannDriveStamped, queue_size=10)
        poses = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=1)
        """,
    "rows": "",
    "connect": "rospy.sleep(1.0)",
    "start": "place(*start)",
    "warm_up": "",
    "drive": """
        rate = rospy.Rate(10)
        for v, delta, seconds in rows:
            for _ in range(round(10 * seconds)):
                send(v, delta)
                rate.sleep()
        """,
    "stop": "send(0.0, 0.0)",
    "end": "",
}
NO_STAMP = {"stamp": "pass"}


def paced(wait, before="", each="", after=""):
    """Return a drive that calls `wait` after each command."""
    wait, each = textwrap.dedent(wait).strip(), textwrap.indent(each or "pass", 4 * " ")
    return {
        "drive": f"{before}\nfor v, delta, seconds in rows:\n{each}\n"
        "    for _ in range(round(10 * seconds)):\n        send(v, delta)\n"
        f"{textwrap.indent(wait, 8 * ' ')}\n{after}"
    }


def until(poll, clock="rospy.Time.now()", step="rospy.Duration(0, 100000000)"):
    """Return a drive with absolute due times, which polls a clock."""
    return paced(f"due += {step}\nwhile {clock} < due:\n    {poll}", f"due = {clock}")


POOL = "from multiprocessing import Pool\ndef parse(number):\n    return 2 * number\n"

THREAD = """
current = (0.0, 0.0)
is_done = False
def work():
    {begin}
    while not is_done:
        send(*current)
        {wait}
"""
MAIN = """
is_first = True
for v, delta, seconds in rows:
    current = (v, delta)
    if is_first:
        is_first = False
        {start}
    rospy.sleep(seconds)
is_done = True
"""


def threaded(wait, begin="pass", start="threading.Thread(target=work, daemon=True).start()"):
    """Return a drive in which a thread sends, and the main thread changes the row."""
    return {
        "functions": THREAD.format(begin=begin, wait=wait),
        "drive": MAIN.format(start=start),
    }


TIMER = """
current = (0.0, 0.0)
def tick(event):
    send(*current)
"""
ON_POSE = """
todo = []
done = threading.Event()
due = None
def on_pose(msg):
    global due
    if not todo:
        return
    now = msg.header.stamp
    due = due or now
    if now >= due:
        send(*todo.pop(0))
        due += rospy.Duration(0, 100000000)
        if not todo:
            done.set()
"""
ASYNC = """
async def drive():
    for v, delta, seconds in rows:
        for _ in range(round(10 * seconds)):
            send(v, delta)
            await asyncio.sleep(0.1)
"""
QUEUE = """
jobs = queue.Queue()
def work():
    rate = rospy.Rate(10)
    while True:
        v, delta = jobs.get()
        send(v, delta)
        rate.sleep()
        jobs.task_done()
"""
START_THREAD = "threading.Thread(target=work, daemon=True).start()"
WAIT = "while not (commands.get_num_connections() and poses.get_num_connections()):\n    "
STRETCHED = """
rate = rospy.Rate(10)
for v, delta, seconds in rows:
    end = rospy.Time.now() + rospy.Duration(seconds)
    while rospy.Time.now() < end:
        send(v, delta)
        rate.sleep()
"""

RIGHT = {
    "plain": {},
    "no_stamp": NO_STAMP,
    "rate_per_row": paced("rate.sleep()", each="rate = rospy.Rate(10)"),
    "sleep": paced("rospy.sleep(0.1)"),
    "sleep_ten_times": paced("for _ in range(10):\n    rospy.sleep(0.01)"),
    "while_rate": {"drive": STRETCHED},
    "while_time_sleep": {"drive": STRETCHED.replace("rate.sleep()", "time.sleep(0.1)")},
    "poll_busy": until("pass"),
    "poll_busy_no_stamp": {**until("pass"), **NO_STAMP},
    "poll_1ms": until("time.sleep(0.001)"),
    "poll_10ms": until("time.sleep(0.01)"),
    "poll_rate": until("fast.sleep()", "rospy.Time.now()") | {"warm_up": "fast = rospy.Rate(50)"},
    "ahead": paced(
        "due += step\nrospy.sleep(due - rospy.Time.now() - step)",
        "due, step = rospy.Time.now() + rospy.Duration(0.1), rospy.Duration(0.1)",
    ),
    "computed_stamps": {
        "drive": """
            begin, count = rospy.Time.now(), 0
            for v, delta, seconds in rows:
                for _ in range(round(10 * seconds)):
                    due = begin + rospy.Duration(0.1) * count
                    rospy.sleep(due - rospy.Time.now())
                    send(v, delta, due)
                    count += 1
            rospy.sleep(0.1)
            """
    },
    "time_sleep": paced("time.sleep(0.1)"),
    "time_sleep_short": {**paced("time.sleep(0.099)"), **NO_STAMP},
    "perf_counter": until("time.sleep(0.001)", "time.perf_counter()", "0.1"),
    "datetime": until(
        "time.sleep(0.001)", "datetime.datetime.now()", "datetime.timedelta(seconds=0.1)"
    ),
    "clock_gettime": until(
        "time.sleep(0.001)", "time.clock_gettime_ns(time.CLOCK_MONOTONIC)", "100000000"
    ),
    "event_wait": paced("threading.Event().wait(0.1)"),
    "select": {**paced("select.select([], [], [], 0.1)"), **NO_STAMP},
    "files": {
        "imports": "import selectors",
        "warm_up": """
            polled, epolled, selector = select.poll(), select.epoll(), selectors.SelectSelector()
            messages = queue.SimpleQueue()
            """,
        **paced(
            """
            polled.poll(20)
            epolled.poll(timeout=0.03, maxevents=1)
            selector.select(timeout=0.02)
            try:
                messages.get(timeout=0.03)
            except queue.Empty:
                pass
            """
        ),
    },
    "wall_rate": paced(
        "rate.sleep()",
        "class Wall:\n    def sleep(self):\n        rospy.rostime.wallsleep(0.1)\nrate = Wall()",
    ),
    "asyncio": {"functions": ASYNC, "drive": "asyncio.run(drive())"},
    "timer": {
        "functions": TIMER,
        "drive": MAIN.format(start="tick(None); timer = rospy.Timer(rospy.Duration(0.1), tick)"),
        "stop": "timer.shutdown(); send(0.0, 0.0)",
    },
    "timer_only": {
        "functions": """
            todo, done = [], threading.Event()
            def tick(event):
                if todo:
                    send(*todo.pop(0))
                else:
                    done.set()
            """,
        "drive": """
            todo += [(v, delta) for v, delta, seconds in rows for _ in range(round(10 * seconds))]
            timer = rospy.Timer(rospy.Duration(0.1), tick)
            while not done.is_set():
                time.sleep(0.05)
            """,
    },
    "thread_rate": threaded("rate.sleep()", "rate = rospy.Rate(10)"),
    "thread_sleep_no_stamp": {**threaded("rospy.sleep(0.1)"), **NO_STAMP},
    "thread_time_sleep": threaded("time.sleep(0.1)"),
    "thread_event": threaded("threading.Event().wait(0.1)"),
    "queue": {
        "functions": QUEUE,
        "drive": f"""
            {START_THREAD}
            for v, delta, seconds in rows:
                for _ in range(round(10 * seconds)):
                    jobs.put((v, delta))
            jobs.join()
            """,
    },
    "on_pose": {
        "functions": ON_POSE,
        "drive": """
            todo += [(v, delta) for v, delta, seconds in rows for _ in range(round(10 * seconds))]
            rospy.Subscriber("/car/car_pose", PoseStamped, on_pose)
            done.wait()
            rospy.sleep(0.1)
            """,
    },
    "pose_listener_time_sleep": {
        **paced("time.sleep(0.1)"),
        "functions": "last = None\ndef on_pose(msg):\n    global last\n    last = msg\n",
        "warm_up": 'rospy.Subscriber("/car/car_pose", PoseStamped, on_pose)',
    },
    "connect_poll": {"connect": WAIT + "rospy.sleep(0.05)"},
    "connect_poll_busy": {"connect": WAIT + "pass"},
    "wait_for_message": {
        "connect": 'rospy.wait_for_message("/car/car_pose", PoseStamped)\n'
        + WAIT
        + "rospy.sleep(0.1)"
    },
    "zeros_first": {
        "start": "for _ in range(10):\n    send(0.0, 0.0)\n    rospy.sleep(0.1)\nplace(*start)"
    },
    "placed_twice": {"start": "place(0.0, 0.0, 0.0)\nrospy.sleep(0.1)\nplace(*start)"},
    "latched": {
        "publishers": """
            commands = rospy.Publisher(CONTROL, AckermannDriveStamped, queue_size=10)
            poses = rospy.Publisher(
                "/initialpose", PoseWithCovarianceStamped, queue_size=1, latch=True)
            """,
    },
    "synchronous": {
        "publishers": """
            commands = rospy.Publisher(CONTROL, AckermannDriveStamped, queue_size=None)
            poses = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=None)
            """,
    },
    "no_stop": {"stop": ""},
    "on_shutdown": {"stop": "", "warm_up": "rospy.on_shutdown(lambda: send(0.0, 0.0))"},
    "stops_for_ever": {
        "stop": "",
        "end": "while not rospy.is_shutdown():\n    send(0.0, 0.0)\n    rospy.sleep(0.1)",
    },
    "spins": {"end": "rospy.spin()"},
    "signal_shutdown": {"end": 'rospy.signal_shutdown("done")'},
    "lingers": {"end": 'rospy.signal_shutdown("done")\ntime.sleep(1.0)'},
    "computes": paced("sum(i * i for i in range(300000))\nrate.sleep()", "rate = rospy.Rate(10)"),
    "child": {
        "warm_up": 'subprocess.run(["true"])',
        **paced("rospy.sleep(0.1)", each='subprocess.run(["true"])'),
    },
    "pool_before": {
        "functions": POOL + "with Pool(2) as pool:\n    double = pool.map(parse, range(10))\n"
    },
    "pool": {
        "functions": POOL,
        "warm_up": "with Pool(2) as pool:\n    double = pool.map(parse, range(10))",
    },
    "reads_the_time_before": {
        "functions": "due = time.time() + 0.2\nwhile time.time() < due:\n    pass"
    },
    "child_places": {
        "start": """
            text = "{{header: {{frame_id: map}}, pose: {{pose: {{position: {{x: {}, y: {}}}, "
            text += "orientation: {{z: {}, w: {}}}}}}}}}"
            x, y, theta = start
            text = text.format(x, y, math.sin(theta / 2.0), math.cos(theta / 2.0))
            kind = "geometry_msgs/PoseWithCovarianceStamped"
            subprocess.run(["rostopic", "pub", "-1", "/initialpose", kind, text])
            """
    },
    "actions": {
        "imports": "import actionlib\nfrom actionlib.msg import TestAction, TestGoal",
        "functions": """
            def execute(goal):
                v, delta, seconds = rows[goal.goal]
                rate = rospy.Rate(10)
                for _ in range(round(10 * seconds)):
                    send(v, delta)
                    rate.sleep()
                server.set_succeeded()
            """,
        "connect": """
            server = actionlib.SimpleActionServer("drive", TestAction, execute, False)
            server.start()
            client = actionlib.SimpleActionClient("drive", TestAction)
            client.wait_for_server()
            rospy.sleep(1.0)
            """,
        "drive": """
            for number in range(len(rows)):
                client.send_goal(TestGoal(goal=number))
                client.wait_for_result()
            """,
    },
    "service": {
        "imports": "from std_srvs.srv import Trigger",
        "functions": """
            def on_call(request):
                rospy.sleep(0.1)
                return True, ""
            """,
        "connect": """
            rospy.Service("~step", Trigger, on_call)
            step = rospy.ServiceProxy("~step", Trigger)
            step.wait_for_service()
            rospy.sleep(1.0)
            """,
        **paced("step()"),
    },
    "forks": {"imports": "if os.fork():\n    sys.exit(os.wait()[1])"},
    "due_since_the_start": {
        "connect": "due = rospy.Time.now() + rospy.Duration(2.0)\n"
        "rospy.sleep(due - rospy.Duration(1.0) - rospy.Time.now())",
        **paced(
            "due += rospy.Duration(0, 100000000)\nrospy.sleep(due - rospy.Time.now())",
            "rospy.sleep(due - rospy.Time.now())",
        ),
    },
    "parameters": paced(
        'rospy.get_param("/car/car_sim/wheelbase")\nrate.sleep()', "rate = rospy.Rate(10)"
    ),
    "chatty": paced(
        'rospy.loginfo("speed %s", v)\nprint("x" * 200)\nrate.sleep()', "rate = rospy.Rate(10)"
    ),
    "numpy": {
        "imports": "import numpy as np",
        "rows": "rows = [tuple(map(float, row)) for row in np.array(rows)]",
    },
}
"""Nodes that pass all checks: the parts that differ, by name."""


def rows(change):
    return {"rows": f"rows = [{change} for v, delta, t in rows]"}


WRONG = {
    "sign": (rows("(v, -delta, t)"), "commands"),
    "degrees": (rows("(v, math.degrees(delta), t)"), "commands"),
    "radians": (rows("(v, math.radians(delta), t)"), "commands"),
    "swapped": (rows("(delta, v, t)"), "commands"),
    "truncated": (rows("(float(int(v)), delta, t)"), "commands"),
    "straight": (rows("(v, 0.0, t)"), "commands"),
    "first_row_missing": ({"rows": "rows = rows[1:]"}, "commands"),
    "last_row_missing": ({"rows": "rows = rows[:-1]"}, "commands"),
    "reversed": ({"rows": "rows = rows[::-1]"}, "commands"),
    "twice": ({"rows": "rows = rows + rows"}, "commands"),
    "stop_after_each_row": (
        paced("rate.sleep()", "rate = rospy.Rate(10)", "send(0.0, 0.0)"),
        "commands",
    ),
    "no_durations": (rows("(v, delta, 1.0)"), "rate"),
    "double_seconds": (rows("(v, delta, 2.0 * t)"), "rate"),
    "hz_5": ({"drive": STRETCHED.replace("Rate(10)", "Rate(5)")}, "rate"),
    "hz_20": ({"drive": STRETCHED.replace("Rate(10)", "Rate(20)")}, "rate"),
    "count_20_hz": (paced("rospy.sleep(0.05)"), "path"),
    "nine_per_row": ({"drive": PARTS["drive"].replace("10 * seconds", "10 * seconds - 1")}, "rate"),
    "once_per_row": (
        {"drive": "for v, delta, seconds in rows:\n    send(v, delta)\n    rospy.sleep(seconds)"},
        "rate",
    ),
    "drops_every_fifth": (
        paced(
            "n += 1\nif n % 5 == 0:\n    rate.sleep()\nrate.sleep()", "n, rate = 0, rospy.Rate(10)"
        ),
        "rate",
    ),
    "burst": (paced("pass"), "path"),
    "endless_burst": ({"drive": "while True:\n    send(1.0, 0.1)"}, "node"),
    "burst_future_stamps": (
        {
            "drive": """
        due = rospy.Time.now()
        for v, delta, seconds in rows:
            for _ in range(round(10 * seconds)):
                send(v, delta, due)
                due += rospy.Duration(0.1)
        """
        },
        "rate",
    ),
    "burst_per_row": (
        {
            "drive": """
        due = rospy.Time.now()
        for v, delta, seconds in rows:
            for _ in range(round(10 * seconds)):
                send(v, delta, due)
                due += rospy.Duration(0.1)
            rospy.sleep(due - rospy.Time.now())
        """
        },
        "rate",
    ),
    "wall_stamps": ({"stamp": "msg.header.stamp = rospy.Time.from_sec(time.time())"}, "rate"),
    "small_stamps": (
        {"stamp": "msg.header.stamp = rospy.Time.from_sec(time.perf_counter())"},
        "rate",
    ),
    "constant_stamps": (
        {"warm_up": "begin = rospy.Time.now()", "stamp": "msg.header.stamp = begin"},
        "rate",
    ),
    "late_stamps": ({"stamp": "msg.header.stamp = rospy.Time.now() - rospy.Duration(5)"}, "rate"),
    "no_start": ({"start": ""}, "start_pose"),
    "unconnected": ({"connect": ""}, "start_pose"),
    "start_after_first_row": (
        {
            "start": "",
            **paced(
                "rate.sleep()",
                "rate = rospy.Rate(10)",
                "if rows.index((v, delta, seconds)) == 1:\n    place(*start)",
            ),
        },
        "start_pose",
    ),
    "start_in_degrees": (
        {"start": "place(start[0], start[1], math.degrees(start[2]))"},
        "start_pose",
    ),
    "start_without_heading": ({"start": "place(start[0], start[1], 0.0)"}, "start_pose"),
    "start_nan": ({"start": "place(math.nan, start[1], start[2])"}, "start_pose"),
    "placed_midway": ({"drive": PARTS["drive"] + "\n        place(*start)\n"}, "topics"),
    "wrong_topic": (
        {"publishers": PARTS["publishers"].replace("(CONTROL,", '("/car/control",')},
        "node",
    ),
    "teleop": (
        {
            "publishers": PARTS["publishers"].replace(
                "(CONTROL,", '(CONTROL.replace("navigation", "teleop"),'
            )
        },
        "node",
    ),
    "wrong_type": (
        {
            "publishers": PARTS["publishers"].replace("AckermannDriveStamped", "AckermannDrive"),
            "functions": "def send(v, delta, stamp=None):\n"
            "    commands.publish(AckermannDrive(speed=v, steering_angle=delta))",
            "connect": "rospy.sleep(1.0)",
        },
        "node",
    ),
    "crashes_at_once": ({"imports": "import nothing_of_this_name"}, "node"),
    "crashes_midway": (
        paced("rate.sleep()", "rate = rospy.Rate(10)", "if v == 2.0:\n    raise IndexError(3)"),
        "node",
    ),
    "crashes_at_end": ({"end": "raise IndexError(3)"}, "node"),
    "exit_status": ({"end": "sys.exit(3)"}, "node"),
    "segfault": ({"end": "os.kill(os.getpid(), signal.SIGSEGV)\ntime.sleep(60)"}, "node"),
    "alarm": (
        {
            **paced("signal.sigwait([signal.SIGALRM])"),
            "imports": "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])",
            "warm_up": "signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)",
        },
        "node",
    ),
    "child_sleeps": (paced('subprocess.run(["sleep", "0.1"])'), "node"),
    "child_timeout": (paced('subprocess.run(["sleep", "0.1"], timeout=1.0)'), "node"),
    "hangs_at_once": ({"connect": "rospy.spin()"}, "node"),
    "hangs_midway": (
        paced("rate.sleep()", "rate = rospy.Rate(10)", "if v == 2.0:\n    rospy.spin()"),
        "node",
    ),
    "hangs_in_a_sleep": (
        paced("rate.sleep()", "rate = rospy.Rate(10)", "if v == 2.0:\n    rospy.sleep(1e6)"),
        "node",
    ),
    "hangs_busily": (
        paced("rate.sleep()", "rate = rospy.Rate(10)", "while v == 2.0:\n    pass"),
        "node",
    ),
    "waits_for_input": ({"connect": "input()"}, "node"),
    "sleeps_too_long": (paced("rospy.sleep(0.1)\nrospy.sleep(0.01)"), "rate"),
    "pauses": (paced("rospy.sleep(0.1)", each="rospy.sleep(1.0)"), "rate"),
    "endless": (
        {"drive": "while True:\n" + textwrap.indent(textwrap.dedent(PARTS["drive"]), "    ")},
        "node",
    ),
    "infinite_speed": (rows("(math.inf, delta, t)"), "commands"),
    "nan": (rows("(v, math.nan, t)"), "commands"),
}
"""Nodes with a mistake: the parts that differ, and a check that fails, by name."""

PLAN = "1,2,0.5\n1.0,0.1\n2.0,-0.1,0.5\n1.5,0.2,1.3\n1.0,-0.2,0.3\n"


def source(parts):
    """Return a node with parts of its own."""
    code = {name: textwrap.dedent(text).strip("\n") for name, text in {**PARTS, **parts}.items()}
    return TEMPLATE.format(**code)


def write(folder):
    """Write all nodes to a folder, one file each."""
    os.makedirs(folder, exist_ok=True)
    nodes = {f"right_{name}": parts for name, parts in RIGHT.items()}
    nodes.update((f"wrong_{name}", parts) for name, (parts, _) in WRONG.items())
    for name, parts in nodes.items():
        os.makedirs(os.path.join(folder, name))
        path = os.path.join(folder, name, "path_publisher.py")
        with open(path, "w", encoding="ascii") as file:
            file.write(source(parts))
        os.chmod(path, 0o755)


if __name__ == "__main__":
    write(sys.argv[1])
