"""Use the page in a real browser: place and drive the car, and lose the connection."""

import contextlib
import math
import os
import re
import signal

import pytest
from PIL import ImageChops

from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.classroom.tables import write_results
from mushr_ros_intro.replay.judge import CHECK_NAMES
from support import browser, web
from support.cars import plan_named
from support.geometry import closed_form
from support.grades import graded, submission
from support.helpers import free_port, node
from support.messages import MUX

pytestmark = pytest.mark.full

if browser.missing():
    reason = f"the packages {', '.join(browser.missing())} are missing; {web.INSTALL}"
    pytest.skip(reason, allow_module_level=True)

from selenium.webdriver.common.keys import Keys  # noqa: E402

FACTOR = 2
"""Speed of simulated time; a drive of figure_8 takes 22 s of it."""

PIXEL = 3.5
"""The largest error of a click [pixel]: roundings in selenium, and the border of the canvas."""

MAP = {"wall": "#000000", "free": "#ffffff", "unknown": "#cdcdcd"}
"""Colours of the map, which are those of map_saver."""

FAULTY = "0, 0, 0\n1.0, 0.0\nfast, 0.1\n1.0, 99.0\n"
COLLIDING = "0, 0, 0\n2.0, 0.0, 30.0\n"

CURRENT = "return document.querySelector('#rows [aria-current]')?.cells[0].textContent ?? ''"
"""Returns the line of the row that is driven; an empty text if none is."""

CHECK_CLASSES = "return [...document.querySelectorAll('#check p')].map((each) => each.className)"
"""Returns the classes of the lines of the check."""

FOCUS = "return document.activeElement.id"
"""Returns the id of the element that has the focus."""

AXE = f"{web.CLIENTS}/node_modules/axe-core/axe.min.js"
"""The accessibility checker of https://github.com/dequelabs/axe-core."""


@pytest.fixture(scope="module")
def sim(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans")
    (folder / "faulty.txt").write_text(FAULTY)
    (folder / "colliding.txt").write_text(COLLIDING)
    (folder / "tight.txt").write_text("0, 0, 0\n2.0, 0.34, 1000.0\n")
    (folder / "many.txt").write_text("0, 0, 0\n" + 3000 * "1, 0.3, 0.01\n" + "1, 0.3, 1000\n")
    (folder / "long.txt").write_text("1, 0, 0\n0.5, 0.3, 0.1\n0.5, 0.3, 1000.0\n")
    # The page does not need the transforms of the model, which cost most of the master's time.
    arguments = ("model:=false", "use_sim_time:=true", f"real_time_factor:={FACTOR}")
    found = web.Simulation(folder, *arguments)
    yield found
    found.end()


@pytest.fixture(scope="module")
def chromium():
    found = browser.Browser()
    yield found
    found.end()


@pytest.fixture
def page(sim, chromium):
    """Yield a browser with the new page of the server, and with the car at rest at the origin."""
    load(chromium, sim)
    chromium.choose("plan", "figure_8")
    chromium.shows("check", "44.00 m")
    place(chromium, 0.0, 0.0, 0.0)
    yield chromium
    chromium.run("window.dispatchEvent(new Event('blur'))")  # it ends a drive by hand
    sim.delete("/drive")


def load(page, sim, is_driving=False):
    page.driver.get(sim.url)
    page.wait(lambda: page.text("connection") == "connected", "a connection")
    page.wait(page.pose, "the pose in the page")
    page.wait(lambda: page.text("check") not in ("", "reading the plan"), "the plan")
    page.wait(lambda: page.find("stop").is_enabled() is is_driving, "the state of the drive")


def colour(page, name):
    """Return a colour of the map, or of the page's style."""
    if name in MAP:
        return MAP[name]
    script = "return getComputedStyle(document.documentElement).getPropertyValue(arguments[0])"
    return page.run(script, f"--{name}").strip()


def seen(page, *names):
    """Return the number of pixels of the canvas in each of these colours."""
    count = browser.colours(page.picture("view"))
    return [count(colour(page, name)) for name in names]


def place(page, x, y, theta):
    """Place the car with the form."""
    for name, value in (("x", x), ("y", y), ("theta", theta)):
        field = page.find(f"place-{name}")
        field.clear()
        field.send_keys(repr(value))
    page.find("pose-form").submit()
    page.wait(lambda: web.is_near(page.pose(), (x, y, theta)), f"the car at {x}, {y}, {theta}")


def test_load(page):
    assert page.driver.title == "MuSHR car" and page.text("problem") == ""
    page.shows("pose", "0.000 m, 0.000 m, 0.000 rad")
    page.shows("speed", "0.00 m/s")
    page.shows("steering", "0.000 rad")
    page.shows("owner", "idle")
    page.shows("check", "22 rows, 22.00 s, 44.00 m; ends at -1.548 m")
    rows = page.run(
        "return [...document.querySelectorAll('#rows tr')].map((each) => each.innerText)"
    )
    assert rows[0] == "1\tstart x 0.000, y 0.000, theta 0.785" and len(rows) == 1 + 22
    names = ("wall", "free", "car", "scan", "predicted")
    page.wait(lambda: all(n > 30 for n in seen(page, *names)), f"the colours of {names}")
    page.find("show-scan").click()
    page.wait(lambda: seen(page, "scan") == [0], "the scan to vanish")
    page.find("show-scan").click()
    page.wait(lambda: seen(page, "scan")[0] > 30, "the scan to appear again")


def test_place(page):
    place(page, 2.5, -0.25, 1.25)
    page.shows("pose", "2.500 m, -0.250 m, 1.250 rad")
    page.find("place").click()
    start = 3.0, 1.0
    down = page.actions().move_to_element_with_offset(page.find("view"), *pixel(page, *start))
    down.click_and_hold().move_by_offset(-50, 0).move_by_offset(0, -50).release().perform()
    error = PIXEL / page.run("return window.mushr.view.scale")
    page.wait(lambda: math.dist(page.pose()[:2], start) < error, f"the car at {start}")
    assert abs(page.pose()[2] - 0.75 * math.pi) < 0.05, "the car heads along the drag"
    page.find("pan").click()


def pixel(page, x, y):
    """Return the offset of a point of the map in the canvas, as selenium expects it.

    From version 4.3 on, it counts from the middle, and before, from the corner.
    """
    from selenium import __version__ as version

    across, down, width, height = page.run(
        "const {canvas, scale, x, y} = window.mushr.view, [a, b] = arguments;"
        "const {clientWidth, clientHeight} = canvas;"
        "return [(a - x) * scale, (y - b) * scale, clientWidth, clientHeight]",
        *(x, y),
    )
    if tuple(map(int, version.split(".")[:2])) < (4, 3):
        across, down = across + width / 2, down + height / 2
    return round(across), round(down)


def test_move_view(page):
    """The moved picture of the map is the one that is drawn there; a pixel is 1/64 m."""
    change = "window.mushr.view.set(...arguments)"

    def picture(*changes):
        page.run(change, *changes)
        page.wait(lambda: not page.run("return window.mushr.view.request"), "the next frame")
        return page.picture("view")

    def moved():
        """Return the moved picture, or None if a message has caused a new one meanwhile."""
        picture({"x": 0.0, "y": 0.0, "scale": 64.0})
        found = picture({"x": 1.5, "y": -0.25}, False)
        return found if page.run("return window.mushr.view.drawn") == [0.0, 0.0] else None

    page.find("show-scan").click()  # a scan can arrive between two pictures
    differences = ImageChops.difference(page.wait(moved, "a moved picture"), picture({}))
    assert max(most for _, most in differences.getextrema()) < 16, "only rounded colours differ"


def test_a_size_that_differs_by_less_than_a_pixel(page):
    """The browser clears the canvas all the same."""
    before = seen(page, "wall", "unknown")
    page.run("window.mushr.view.canvas.style.width = 'calc(100% - 0.3px)'")
    page.wait(lambda: not page.run("return window.mushr.view.request"), "the next frame")
    after = seen(page, "wall", "unknown")
    page.run("window.mushr.view.canvas.style.width = ''")
    assert min(after) > 0 and after == before


def test_keys(page):
    place(page, 1.0, 0.0, 0.0)
    page.find("view").click()
    page.actions().key_down("w").perform()
    page.shows("hand-state", "2.00 m/s, 0.00 rad")
    page.wait(lambda: page.pose()[0] > 1.5, "the car to drive forward")
    page.actions().key_down("a").perform()
    page.wait(lambda: page.pose()[2] > 0.1, "the car to turn left")
    page.actions().key_up("a").key_up("w").perform()
    at_rest(page)
    start = page.pose()[:2]
    page.actions().key_down("s").perform()
    page.wait(lambda: math.dist(page.pose()[:2], start) > 0.2, "the car to drive back")
    page.run("window.dispatchEvent(new Event('blur'))")  # another window has the focus
    at_rest(page)
    page.actions().key_up("s").perform()


def press(page, *events):
    """Let the browser see that keys go up or down, as on a keyboard that selenium has not.

    Return what the page says about driving by hand after the next command.
    """
    return page.run(
        "for (const [kind, key, code] of arguments)"
        "  document.body.dispatchEvent(new KeyboardEvent(kind, { key, code, bubbles: true }));"
        "await new Promise((resume) => setTimeout(resume, 250));"  # two periods of the commands
        "return document.getElementById('hand-state').textContent",
        *events,
    )


HELD = ("keydown", "w", "KeyW")
STICKING = [
    # what happens while W is held: the release of W is not reported, or under another name
    [("keydown", "Meta", "MetaLeft"), ("keyup", "Meta", "MetaLeft")],  # macOS
    [("keydown", "Alt", "AltLeft"), ("keyup", "\u2211", "KeyW")],
    [("keydown", "AltGraph", "AltRight"), ("keyup", "\u0142", "KeyW")],
    [("keydown", "Shift", "ShiftLeft"), ("keyup", "Shift", "ShiftLeft")],
    [("keydown", "F5", "F5")],
    [("keyup", "\u0446", "KeyW")],  # the layout of the keyboard has changed
]


@pytest.mark.parametrize("events", STICKING)
def test_no_key_sticks(page, events):
    assert press(page, HELD) == "keys: 2.00 m/s, 0.00 rad"
    assert "at most" in press(page, *events)
    at_rest(page)


GAMEPADS = {
    "missing": "undefined",
    "forbidden": "() => { throw new Error('forbidden') }",
    "without axes": "() => [{ ...window.pad, axes: [] }]",
    "gone": "() => [{ ...window.pad, connected: false }]",
}


@pytest.mark.parametrize("name", GAMEPADS)
def test_a_gamepad_does_not_silence_the_keys(page, name):
    page.run(
        "window.pad = { connected: true, mapping: 'standard', axes: [0, -1, 0, 0],"
        "  buttons: [{}, {}, {}, {}, { pressed: true }] };"
        "document.hasFocus = () => true; navigator.getGamepads = () => [null, window.pad]"
    )
    page.shows("hand-state", "gamepad: 2.00 m/s, 0.00 rad")
    page.run(f"navigator.getGamepads = {GAMEPADS[name]}")
    page.shows("hand-state", "at most")
    assert press(page, HELD) == "keys: 2.00 m/s, 0.00 rad"
    page.wait(lambda: page.pose()[0] > 0.5, "the car to drive")


def test_a_dead_mux_is_missed(sim, page):
    """The page is not a subscriber for which path_publisher takes the mux."""
    page.shows("owner", "idle")  # the page has subscribed to all of its topics but the last
    _, subscribers, _ = sim.proxy.getSystemState()
    nodes = {topic: names for topic, names in subscribers if "/input/" in topic}
    assert nodes and {name for names in nodes.values() for name in names} == {MUX}, nodes


def test_a_car_that_does_not_answer(sim, page):
    """The page does not show that the car has ended."""
    car = sim.pid("/car/car_sim")
    os.kill(car, signal.SIGSTOP)
    try:
        page.shows("problem", "no pose: the clock is held, or the machine is busy")
    finally:
        os.kill(car, signal.SIGCONT)


def test_another_car(sim, page):
    """The page of a car that is not running, and of its mux, which then starts and ends."""
    port = free_port()
    sim.proxy.setParam("/red/mux/ackermann_cmd_mux", sim.proxy.getParam(MUX))
    settings = ("__ns:=/red", "__name:=web_view", "_car_name:=red", f"_port:={port}")
    with node("web_view.py", *settings, **sim.environment) as process:
        page.wait(lambda: "in a browser" in process.output, "the other server")
        page.driver.get(f"http://localhost:{port}")
        page.shows("owner", "no mux is running")
        page.shows("problem", "no pose: no simulated car is running")
        assert page.driver.title == page.text("title") == "MuSHR red"
        with node("ackermann_cmd_mux.py", "__ns:=/red/mux", **sim.environment):
            page.shows("owner", "idle")
        page.shows("owner", "no mux is running")


def at_rest(page):
    """Wait until the car has stopped, not at a wall, and has one pose for 1 s of simulated time."""
    page.shows("hand-state", "at most")
    page.shows("owner", "idle")
    page.shows("speed", "0.00 m/s")
    first = {}

    def stands():
        pose = page.run("return window.mushr.pose")
        if pose != {**first, "stamp": pose["stamp"]}:
            first.update(pose)
        return pose["stamp"] > first["stamp"] + 1.0

    page.wait(stands, "the car to stand still")


def test_figure_8(page):
    plan = plan_named("figure_8")
    rows = [(*row[:2], row.duration / 1e9) for row in plan.rows]
    final = closed_form(plan.start, rows)
    page.find("fit").click()
    page.find("drive").click()
    page.shows("drive-state", "the car drove 44.00 m and stopped at")
    page.wait(lambda: web.is_near(page.pose(), final), f"the car at {final}")
    assert page.run(CURRENT) == "", "no row is current after the drive"
    length = 44.0 * page.run("return window.mushr.view.scale")
    page.wait(lambda: seen(page, "driven")[0] > length, "the driven path")
    page.shows("log", "should end at")
    page.choose("plan", "circle")
    page.shows("check", "ends at 0.000 m, 0.000 m, 0.000 rad")
    assert page.text("drive-state") == "", "the result of figure_8 beside another plan"


def drive(page, plan, speed):
    """Start the drive of a plan that does not end before the test; wait for its speed."""
    page.choose("plan", plan)
    page.wait(lambda: page.find("drive").is_enabled(), f"the plan {plan}")
    page.find("drive").click()
    page.shows("speed", speed)


def test_stop(sim, page):
    drive(page, "long", "0.50 m/s")
    page.shows("drive-state", "driving long")
    assert not page.find("drive").is_enabled() and page.find("stop").is_enabled()
    page.shows("owner", "navigation")
    page.wait(lambda: page.run(CURRENT) == "3", "the mark of the second row")
    load(page, sim, is_driving=True)
    page.wait(lambda: page.run(CURRENT) == "3", "the same mark after a reload")
    red = page.run("return getComputedStyle(document.getElementById('stop')).backgroundColor")
    assert red == "rgb(179, 32, 10)"
    page.find("stop").click()
    page.shows("drive-state", "the drive of long was stopped")
    at_rest(page)
    load(page, sim)
    page.shows("drive-state", "the drive of long was stopped")  # also after a reload


def test_stop_without_a_connection(sim, page):
    """The button also works while the page tries to connect again."""
    drive(page, "long", "0.50 m/s")
    pid = sim.pid("/web_view")
    os.kill(pid, signal.SIGSTOP)
    try:
        page.shows("connection", "not connected")
        page.find("stop").click()
    finally:
        os.kill(pid, signal.SIGCONT)
    page.shows("drive-state", "the drive of long was stopped")
    at_rest(page)


def test_simulated_time(sim, page):
    assert page.find("time-section").is_displayed()
    stamp = "return window.mushr.pose.stamp"
    try:
        page.find("pause").click()
        text = page.shows("time-state", "; placing the car takes effect at the next step")
        held = float(re.match(r"held at (\d+\.\d\d) s;", text)[1])
        page.wait(lambda: page.run(stamp) > held - 0.02, "the last pose")
        before = page.run(stamp)
        page.find("step").click()
        page.wait(lambda: page.run(stamp) > before, "a step")
        assert abs(page.run(stamp) - before - 0.02) < 1e-3, "a step of one pose"
        assert page.text("problem") == "", "no complaint that there is no pose"
        page.shows("time-state", " s")
        client = sim.client()
        assert client.call("/car/car_sim/resume")[0] is True  # another client releases the clock
        client.close()
        page.wait(lambda: page.text("time-state") == "", "no time at which the clock is held")
    finally:
        page.find("resume").click()
    page.wait(lambda: page.run(stamp) > before + 1.0, "time to run again")
    assert page.text("time-state") == ""


def test_a_drive_that_waits(page):
    """The page says that the plan is driven when the first row begins, not before."""
    page.find("pause").click()
    page.shows("time-state", " s")
    page.find("drive").click()
    page.shows("drive-state", "starting figure_8")
    page.run(
        "return import('./plan.js').then(({ onOutput }) => onOutput(...arguments))",
        *({"header": {"stamp": {"secs": 0, "nsecs": 0}}, "drive": {"speed": 1.0}}, "navigation"),
    )
    assert (
        page.text("drive-state") == "starting figure_8"
    ), "another node drives, not path_publisher"
    page.find("resume").click()
    page.shows("drive-state", "driving figure_8")


def test_plans_with_faults(page):
    page.choose("plan", "faulty")
    text = page.shows("check", "cannot be driven")
    assert "line 3" in text and "line 4" in text
    assert not page.find("drive").is_enabled()
    assert page.run(CHECK_CLASSES) == ["", "error", "error"], "what forbids the drive"
    page.choose("plan", "colliding")
    text = page.shows("check", "1 row, 30.00 s; hits a wall after 49.02 m, at 49.020 m")
    assert "line 2" in text and "at t = 24.5 s" in text
    assert page.run(CHECK_CLASSES) == ["", "warning"], "what does not"
    assert page.find("drive").is_enabled(), "faults of a plan that can be parsed do not prevent it"


def test_a_plan_for_a_car_with_noise(sim, page):
    """The page checks the plan again if the car changes."""
    assert "random" not in page.text("check")
    noise = {"noise": True, "speed_noise": 0.1}
    before = sim.proxy.getParam("/car/car_sim")
    client = sim.client(web.STATE)
    sim.proxy.setParam("/car/car_sim", {**before, **noise})
    try:
        # A check for another reason can see the noise before the server looks for it.
        client.state(lambda state: "speed_noise: 0.1" in state["car"], "the noise")
        page.shows("check", "0.785 rad, without random errors")
    finally:
        sim.proxy.setParam("/car/car_sim", before)
        client.close()
    page.wait(lambda: "random" not in page.text("check"), "the plan of the car without noise")


def test_a_plan_with_many_rows(page):
    """The table has the first ones only: a browser needs gigabytes for 50,000."""
    drive(page, "many", "1.00 m/s")
    page.shows("check", "3001 rows, 1030.00 s")
    assert page.run("return document.querySelectorAll('#rows tr').length") == 1002
    others = "... and 2001 more rows"
    page.shows("rows", others)
    page.wait(lambda: page.run(CURRENT) == others, "the mark of the other rows")
    page.find("stop").click()
    page.shows("drive-state", "the drive of many was stopped")


def test_click_a_plan(page):
    place(page, 1.0, 0.0, 0.0)
    page.find("clicks").click()
    page.find("clear").click()
    page.shows("click-state", "the plan has 0 rows")
    page.find("follow").click()
    centre = "return [window.mushr.view.x, window.mushr.view.y]"
    page.wait(lambda: math.dist(page.run(centre), (1.0, 0.0)) < 1e-6, "the view at the car")
    for _ in range(3):
        page.find("zoom-in").click()
    for number, point in enumerate([(2.0, 0.2), (3.5, 0.9)], 1):
        at = pixel(page, *point)
        page.actions().move_to_element_with_offset(page.find("view"), *at).click().perform()
        page.shows("click-state", f"click {number}")
    page.wait(lambda: seen(page, "clicked")[0] > 100, "the path of the clicked plan")
    both = seen(page, "clicked")[0]
    page.find("undo").click()
    page.shows("click-state", "the plan has 1 row")
    page.wait(lambda: seen(page, "clicked")[0] < both, "a shorter path")
    page.find("save").click()
    page.shows("click-state", "clicked.txt")
    page.wait(lambda: page.run("return document.getElementById('plan').value") == "clicked", "it")
    page.shows("check", "1 row")
    at = pixel(page, 1.95, 0.35)  # beside the car: it would have to steer too much
    page.actions().move_to_element_with_offset(page.find("view"), *at).click().perform()
    page.shows("click-state", "refused")
    note = page.find("click-state").rect
    canvas = page.find("view").rect
    assert canvas["y"] < note["y"] < canvas["y"] + canvas["height"], "not on the map"
    page.find("pan").click()
    assert page.text("click-state") == ""


def test_late_answers(page):
    """The page says so once, but keeps a connection over which messages arrive, and loses none."""
    page.run(
        "const send = WebSocket.prototype.send; WebSocket.prototype.send ="
        " function (text) { if (!text.includes('get_time')) send.call(this, text) }"
    )
    page.shows("problem", "web_view.py) does not answer")
    page.run(
        "window.changes = [];"
        "new MutationObserver((all) => window.changes.push(...all))"
        ".observe(document.getElementById('problem'), { childList: true })"
    )
    stamp = "return window.mushr.pose.stamp"
    before = page.run(stamp)
    page.wait(lambda: page.run(stamp) > before + 8.0 * FACTOR, "8 s without an answer")
    assert page.text("connection") == "connected"
    assert page.text("problem") == "the server of this page (web_view.py) does not answer"
    assert page.run("return window.changes.length") == 0, "a screen reader reads each change"


def test_connection_is_lost_and_regained(sim, page):
    pid = sim.pid("/web_view")
    os.kill(pid, signal.SIGSTOP)
    page.shows("problem", "web_view.py) does not answer")
    os.kill(pid, signal.SIGKILL)
    page.shows("connection", "not connected")
    assert not page.find("drive").is_enabled()
    page.find("stop").click()
    page.shows("drive-state", "the server does not answer")
    page.run("return import('./plan.js').then(({ updateDrive }) => updateDrive(undefined))")
    assert "the server does not answer" in page.text("drive-state"), "the answer is overwritten"
    (outline,) = seen(page, "car")
    page.run("window.mushr.pose = null")
    sim.start("web_view.py", "__name:=web_view")
    page.wait(lambda: page.text("connection") == "connected", "a connection")
    page.wait(page.pose, "a new pose")
    page.wait(lambda: page.text("problem") == "", "no problem")
    page.wait(lambda: page.find("drive").is_enabled(), "the plan")
    page.wait(lambda: outline < seen(page, "car")[0], "the car, of which there was an outline")
    place(page, 1.5, 0.0, 0.5)


def test_another_map(sim, page):
    def width():
        return page.run("return window.mushr.view.map?.width")

    page.wait(lambda: width() == 1000, "the map sandbox")
    page.choose("plan", "colliding")
    page.shows("check", "hits a wall after 49.02 m")
    before = seen(page, "wall", "unknown")
    with node("map_server.py", "_map_file:=rooms", **sim.environment):
        page.wait(lambda: width() == 580, "the other map")
        page.wait(lambda: seen(page, "wall", "unknown") != before, "another picture")
        page.wait(lambda: "49.02 m" not in page.text("check"), "another check of the plan")
        page.shows("check", "hits a wall after")
    sim.start("map_server.py", "_map_file:=sandbox")  # for the other tests
    page.wait(lambda: width() == 1000, "the map sandbox")


OFF_WALLS = """
    // The points of the scan that are more than two cells from any wall.
    const { scan, map } = window.mushr.view;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [map.width, map.height];
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.drawImage(map.picture, 0, 0);
    return scan.filter(([x, y]) => {
      const column = Math.floor((x - map.origin[0]) / map.resolution);
      const row = map.height - 1 - Math.floor((y - map.origin[1]) / map.resolution);
      const { data } = pen.getImageData(column - 2, row - 2, 5, 5);
      return !data.some((value, i) => i % 4 === 0 && value < 50);
    }).length;
"""


def test_a_drive_in_a_terminal(page, sim):
    """The page shows its plan and the current row, also if it is opened later, and can stop it."""
    with node("path_publisher.py", "_plan_file:=circle", **sim.environment) as process:
        page.shows("check", "12.00 m")
        page.shows("drive-state", "the drive of circle has ended")
        assert process.wait() == 0
    load(page, sim)
    page.shows("check", "12.00 m")
    for _ in range(2):  # the page shows a plan that is driven twice, also if it shows another one
        page.choose("plan", "figure_8")
        page.shows("check", "44.00 m")
        with node("path_publisher.py", "_plan_file:=long", **sim.environment) as process:
            page.shows("drive-state", "driving long")
            assert page.find("plan").get_attribute("value") == "long"
            page.wait(lambda: page.run(CURRENT) == "3", "the mark of the second row")
            page.actions().send_keys(Keys.ESCAPE).perform()
            page.shows("drive-state", "the drive of long was stopped")
            assert process.wait() == 1
        at_rest(page)


def test_a_plan_that_has_been_changed(sim, page):
    """The result of a drive is shown with its plan, or with the one that was chosen at its end."""
    path = os.path.join(sim.environment["PWD"], "changed.txt")
    try:
        for rows in ("2.0, 0.0", "2.0, 0.1"):
            with open(path, "w") as file:
                file.write(f"0, 0, 0\n{rows}, 1.0\n")
            page.choose("plan", "changed")
            page.wait(lambda: page.text("drive-state") == "", "no result of the last version")
            page.wait(lambda: page.find("drive").is_enabled(), "the plan")
            page.find("drive").click()
            page.shows("drive-state", "the car drove 2.00 m and stopped at")
        with open(path, "w") as file:
            file.write("0, 0, 0\n0.5, 0.3, 1000.0\n")
        page.shows("check", "1 row, 1000.00 s")
        drive(page, "changed", "0.50 m/s")
        page.shows("drive-state", "driving changed")
        with open(path, "a") as file:
            file.write("0.5, 0.0\n")
        page.shows("drive-state", "driving another version of changed")
        page.choose("plan", "circle")
        page.shows("drive-state", "driving changed")
        page.find("stop").click()
        page.shows("drive-state", "the drive of changed was stopped")  # beside the plan circle
        page.choose("plan", "figure_8")
        page.wait(lambda: page.text("drive-state") == "", "no result beside another choice")
        page.choose("plan", "changed")
        page.shows("check", "2 rows")
    finally:
        os.remove(path)
    page.shows("check", "there is no plan changed")
    assert not page.find("drive").is_enabled(), "another plan would be driven"
    assert page.find("plan").get_attribute("value") == ""


def test_the_log_of_another_car(sim, page):
    """The page shows that of its own car only."""

    def sender(namespace, topic):
        arguments = (f"__ns:={namespace}", "_plan_file:=circle", f"_control_topic:={topic}")
        return node("path_publisher.py", *arguments, **sim.environment)

    with sender("/red", "/red/nowhere") as red, sender("/", "/nowhere") as own:
        assert (red.wait(), own.wait()) == (1, 1)
    last = "return document.getElementById('log').lastChild.textContent"
    page.wait(lambda: "no node subscribes to /nowhere" in page.run(last), "the newest line, below")
    assert "/red" not in page.text("log")


POSE_BETWEEN = """
    const { poseAt } = await import("/scan.js");
    const [seconds] = arguments;
    return poseAt([{ stamp: 0, pose: [0, 0, 0] }, { stamp: seconds, pose: [0.1, 0, 0] }], 0.01);
"""
"""Returns the pose 0.01 s after the first of two."""


def test_scan_in_turns(page):
    """The laser scan stays on the walls while the car turns, also if the page gets few poses."""
    assert page.run(POSE_BETWEEN, 0.05) == pytest.approx([0.02, 0.0, 0.0])
    assert page.run(POSE_BETWEEN, 0.1) is None  # the car may have begun to drive later
    drive(page, "tight", "2.00 m/s")
    stamp = "return window.mushr.pose.stamp"
    before = page.run(stamp)
    while page.run(stamp) < before + 10.0:
        assert page.run("return window.mushr.view.scan.length") > 10
        assert page.run(OFF_WALLS) == 0


def touch(page, name, up, is_tap=False):
    """Hold a finger `up` pixels above the middle of an element; return what lifts the finger.

    A tap is one request, because on a busy machine the finger would otherwise rest on the element.
    """
    from selenium.webdriver.common.actions import interaction
    from selenium.webdriver.common.actions.action_builder import ActionBuilder
    from selenium.webdriver.common.actions.pointer_input import PointerInput

    finger = PointerInput(interaction.POINTER_TOUCH, "finger")
    actions = ActionBuilder(page.driver, mouse=finger)
    x, y, width, height = (page.find(name).rect[key] for key in ("x", "y", "width", "height"))
    scrolled = page.run("return scrollY")
    middle = round(x + width / 2), round(y + height / 2 - scrolled)
    actions.pointer_action.move_to_location(middle[0], middle[1]).pointer_down()
    actions.pointer_action.move_to_location(middle[0], middle[1] - up)
    if is_tap:
        actions.pointer_action.pointer_up()
    actions.perform()
    return actions.clear_actions


def tap(page, name):
    page.run("document.getElementById(arguments[0]).scrollIntoView({ block: 'nearest' })", name)
    touch(page, name, 0, is_tap=True)


@contextlib.contextmanager
def sized(page, width, height):
    """Let the page have a size [pixel]."""
    size = page.driver.get_window_size()
    frame = page.run("return [outerWidth - innerWidth, outerHeight - innerHeight]")
    try:
        page.driver.set_window_size(width + frame[0], height + frame[1])
        page.wait(lambda: page.run("return [innerWidth, innerHeight]") == [width, height], "it")
        yield
    finally:
        page.driver.set_window_size(size["width"], size["height"])


def test_phone(page):
    """On a phone, map, touch pad and the buttons of the plan are on the first screen."""
    with sized(page, 360, 640):
        inside = """
            const { top, bottom, left, right } = document.getElementById(arguments[0])
              .getBoundingClientRect();
            return top >= 0 && bottom <= 640 && left >= 0 && right <= 360 && bottom > top;
        """
        for name in ("view", "place", "clicks", "pad", "drive", "stop", "plan"):
            assert page.run(inside, name), f"{name} is not on the first screen"
        lift = touch(page, "pad", 50)
        page.shows("hand-state", "touch pad")
        page.wait(lambda: page.pose()[0] > 1.0, "the car to drive")
        lift()
        at_rest(page)
        page.run("scrollTo(0, document.body.scrollHeight)")
        for name in ("view", "place", "clicks"):
            assert page.run(inside, name), f"{name} does not stay in view"
        tap(page, "clicks")
        assert page.run(inside, "save") and page.run(inside, "undo")
        tap(page, "pan")


TARGETS = "label, #tools button, #panel button, select, [tabindex]"


@pytest.mark.parametrize("size", [(360, 640), (800, 600), (1024, 600)])
def test_design(page, size):
    """The order of Tab is that on the screen, targets have a size, and the map is large."""
    with sized(page, *size):
        boxes = page.run(
            "return [...document.querySelectorAll(arguments[0])]"
            "  .filter((each) => each.offsetHeight && !each.closest('#zoom'))"
            "  .map((e) => [e.getBoundingClientRect(), e.closest('main > *').id, e.id])",
            TARGETS,
        )
        assert len(boxes) > 20
        for before, after in zip(boxes, boxes[1:]):
            if size[0] == 360 or before[1] == after[1]:
                assert after[0]["bottom"] > before[0]["top"], f"{after} is above {before}"
                is_row = after[0]["top"] < before[0]["bottom"]
                assert not is_row or after[0]["left"] > before[0]["left"], f"{after}, {before}"
        for box, *name in boxes:
            assert box["height"] >= 24.0 and box["width"] >= 24.0, name
        height = page.run("return document.getElementById('view').clientHeight")
        assert height >= (150 if size[0] == 360 else 350)
        assert page.run("return document.documentElement.scrollWidth <= innerWidth"), "too wide"
        scrolled = (
            "const { scrollHeight: all, clientHeight: seen } = document.querySelector('#stage')"
        )
        assert page.run(f"{scrolled}; return all <= seen"), "a scroll bar beside the map"


def test_a_drive_with_the_keyboard(page):
    """Tab leads to the plan and its buttons, and the focus stays there while the plan is driven."""
    with sized(page, 360, 640):
        page.run("document.activeElement.blur()")
        for name in ("plan", "drive"):
            while page.run(FOCUS) != name:
                page.actions().send_keys(Keys.TAB).perform()
            if name == "plan":
                page.actions().send_keys("long").perform()
                page.shows("check", "1000.10 s")
                page.wait(lambda: page.find("drive").is_enabled(), "the plan")
        page.actions().send_keys(Keys.ENTER).perform()
        page.shows("speed", "0.50 m/s")
        assert page.run(FOCUS) == "stop"
        page.actions().send_keys(Keys.ENTER).perform()
        page.shows("drive-state", "the drive of long was stopped")
        assert page.run(FOCUS) == "drive"
        at_rest(page)


def test_a_drive_with_a_finger(page):
    with sized(page, 360, 640):
        page.choose("plan", "long")
        page.wait(lambda: page.find("drive").is_enabled(), "the plan")
        tap(page, "drive")
        page.shows("speed", "0.50 m/s")
        lift = touch(page, "stop", 0)
        page.shows("drive-state", "the drive of long was stopped")
        lift()
        at_rest(page)


def test_the_pointer(page):
    """The page shows where it is, as the axes do."""
    for x, y in ((2.0, -1.0), (-1.0, 2.0)):
        at = pixel(page, x, y)
        page.actions().move_to_element_with_offset(page.find("view"), *at).perform()
        shown = [float(each) for each in re.findall(r"-?\d+\.\d+", page.text("pointer"))]
        assert math.dist(shown, (x, y)) < PIXEL / page.run("return window.mushr.view.scale")


def serious(driver):
    """Return the serious findings of the accessibility checker on the page that is shown."""
    with open(AXE, encoding="utf-8") as file:
        driver.execute_script(file.read())
    return driver.execute_async_script(
        "const [done] = arguments; axe.run().then(({ violations }) => done(violations"
        "  .filter(({ impact }) => ['serious', 'critical'].includes(impact))"
        "  .map(({ id, nodes }) => [id, ...nodes.map(({ html }) => html)])))"
    )


@pytest.mark.skipif(not os.path.exists(AXE), reason=f"axe-core is missing; {web.INSTALL}")
def test_access(page, tmp_path):
    """The page, wide and narrow, and the page of a student have no serious finding."""
    for size in ((1024, 600), (360, 640)):
        with sized(page, *size):
            assert serious(page.driver) == [], size
    result = submission(graded(), graded("slalom", failed=CHECK_NAMES[:2]))
    write_results(str(tmp_path), [result], Points(("circle", "slalom")))
    (student,) = (tmp_path / "students").glob("*.html")
    for path in (student, tmp_path / "index.html"):
        page.driver.get(path.as_uri())
        assert serious(page.driver) == [], path
