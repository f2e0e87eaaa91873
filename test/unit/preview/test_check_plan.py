"""The checks of a plan: against closed forms, against the simulated car, and by hand."""

import math
import os
import re
import sys

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.quiver import Quiver

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import exit_status
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import PlanError, as_float32
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.preview.limits import slowed
from mushr_ros_intro.preview.plot import draw_report
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.preview.spread import spread
from mushr_ros_intro.preview.text import as_text
from mushr_ros_intro.world.footprint import World
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.map_file import read_map
from support.cars import CARS, EACH_PLAN, plan_named, plan_of
from support.helpers import Process
from support.paths import FIXTURES, PACKAGE

sys.path.append(os.path.join(PACKAGE, "src"))

import check_plan  # noqa: E402

BROKEN = ("many.txt", "nan.txt")
PROGRAM = os.path.join(PACKAGE, "src", "check_plan.py")

SAME = 1e-9
"""[m, rad, s] Between closed forms and sums of doubles."""

BOX = 2e-4
"""[m] Of a bounding box, with 1e-4 for each side of the comparison."""


def checked(text, car="ideal", grid=None):
    name, car = (car, CARS[car]) if isinstance(car, str) else ("slow", car)
    return check(plan_of(text), name, car, "the map" if grid else "", grid)


def faults(text, car="ideal", grid=None):
    return [str(fault) for fault in checked(text, car, grid).faults]


def report_on(name, car="ideal"):
    return check(plan_named(name), car, CARS[car], "", None)


def walled(free_to=5.0):
    """Return a map with walls around x = -2 m to `free_to` and y = -2 m to 2 m."""
    cells = np.full((60, 120), 100, np.int8)
    cells[10:50, 10 : 30 + round(10 * free_to)] = 0
    return Grid(cells, 0.1, Pose(-3.0, -3.0, 0.0))


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize("name", EACH_PLAN)
def test_the_report_agrees_with_the_prediction(name, car):
    report, quiet = report_on(name, car), CARS[car]
    states = prediction.states_at(report.plan, quiet, [step.end for step in report.steps[:-1]])
    assert [step.pose for step in report.steps[:-1]] == [state.pose for state in states]
    assert (report.rest, report.final_pose) == prediction.rest(report.plan, quiet)
    assert [step.begin for step in report.steps[1:]] == [step.end for step in report.steps[:-1]]
    assert report.steps[-1].begin == report.plan.duration


def test_the_figures_of_figure_8():
    """At 2 m/s and 0.09 rad the radius is L / tan(0.09), and each lobe is an arc of 22 m."""
    report = report_on("figure_8")
    radius = 0.33 / math.tan(as_float32(0.09))
    assert report.length == pytest.approx(44.0, abs=SAME)
    x, y = -radius * math.sin(0.785), radius * math.cos(0.785)  # the centre of the first lobe
    left, right, bottom, top = report.box
    assert (left, top) == pytest.approx((x - radius, y + radius), abs=BOX)
    turned = 22.0 / radius + 0.785
    x += 2.0 * radius * math.sin(turned)  # and that of the second one
    y -= 2.0 * radius * math.cos(turned)
    assert (right, bottom) == pytest.approx((x + radius, y - radius), abs=BOX)


def test_the_box_of_a_circle_in_one_row():
    radius = 0.33 / math.tan(as_float32(0.3))
    expected = (-radius, radius, 0.0, 2.0 * radius)
    for seconds in (7, 100, 1e9):
        assert checked(f"0,0,0\n1,0.3,{seconds}\n").box == pytest.approx(expected, abs=BOX)


def test_the_distance_there_and_back_counts_twice():
    """From 1 m/s forward to 1 m/s in reverse the speed passes through zero."""
    report = checked("0, 0, 0\n1, 0, 1\n-1, 0, 1\n", Car(acceleration=2.0))
    assert [step.distance for step in report.steps] == pytest.approx([0.75, 0.25 + 0.25, 0.25])
    assert [step.pose.x for step in report.steps] == pytest.approx([0.75, 0.75, 0.5])
    assert report.box == pytest.approx((0.0, 1.0, 0.0, 0.0))
    assert report.length == pytest.approx(1.5)
    # A stop is repeated while the car brakes: at 1 m/s^2, from 1 m/s in 1 s and 0.5 m.
    report = checked("0, 0, 0\n1, 0, 4\n0, 0, 0.5\n0, 0, 3\n", Car(acceleration=1.0))
    assert [step.distance for step in report.steps] == pytest.approx([3.5, 0.375, 0.125, 0.0])


def test_a_command_that_expires_before_the_next_one():
    """It is good for 0.05 s of each 0.1 s."""
    report = checked("0,0,0\n1,0\n", Car(command_timeout=50_000_000))
    assert len(report.steps) == 2
    assert report.length == pytest.approx(0.5)
    assert report.final_pose.x == pytest.approx(0.5)


def test_noise_is_left_out():
    text = "0,0,0\n1,0,9\n"
    report = checked(text, Car(speed_noise=0.2, steering_noise=0.1), walled())
    assert report._replace(car_name="ideal") == checked(text, grid=walled())


def test_the_table():
    text = list(as_text(checked("# a plan\n1, 2, 0\n2.0, 0, 1.5\n-1, 0\n")))
    assert text == [
        "my.txt: 2 rows, on the ideal car",
        "no faults",
        "",
        "   line   speed  steering  duration  distance     turn         x         y    theta",
        "            m/s       rad         s         m      rad         m         m      rad",
        "  start                                                 1.000     2.000    0.000",
        "      3    2.00    0.0000      1.50     3.000    0.000     4.000     2.000    0.000",
        "      4   -1.00    0.0000      1.00     1.000    0.000     3.000     2.000    0.000",
        "",
        "length          4.00 m",
        "duration        2.5 s",
        "final pose      x 3.000 m, y 2.000 m, theta 0.000 rad",
        "bounding box    x 1.000 to 4.000 m, y 2.000 to 2.000 m (of the rear axle)",
        "ends at rest    no, the last row asks for -1 m/s; path_publisher then sends a stop",
    ]


def test_the_turn_of_a_row():
    text = list(as_text(checked("1, 2, 0.5\n1, 0.2, 2\n1, -0.1\n")))
    turns = [2.0 * math.tan(0.2), math.tan(-0.1)]
    expected = [each / Car().wheelbase for each in turns]
    assert [float(line.split()[5]) for line in text[6:8]] == pytest.approx(expected, abs=6e-4)


def test_special_lines_of_the_table():
    # Numbers that round to zero have no minus sign.
    text = "\n".join(as_text(checked("0,0,0\n-0.0004,0\n0.0044,0\n")))
    assert "final pose      x 0.004 m, y 0.000 m" in text
    assert "bounding box    x 0.000 to 0.004 m" in text
    # Long tables and lists of faults are cut.
    text = list(as_text(checked("0, 0, 0\n" + "1, 0.1\n9, 0.1\n" * 500, "mushr_tx2")))
    assert "    ... 960 more rows ..." in text
    assert text[21:23] == ["... and 480 more faults", "500 faults"]
    assert len(text) < 90
    # A car with ramps has a line for its stop.
    text = "\n".join(as_text(checked("0, 0, 0\n0.5, 0\n", "mushr_nano")))
    assert "\n   stop    0.00    0.0000      0.13     0.032    0.000" in text
    assert "and the car rolls on for 0.032 m" in text


def test_rows_beyond_the_limits():
    text = "\ufeff0,0,0\r\n\r\n0.9, 0\r\n  6.6 , -0.45\r\n 5, 0.5\r\n-1,0,2 # back\r\n"
    assert faults(text, "mushr_nano") == [
        "my.txt:4:3: lines 4 to 5 ask for 5 to 6.6 m/s; the mushr_nano does 0.9286 m/s at most",
        "my.txt:4:9: line 4 asks for -0.45 rad; the mushr_nano steers 0.4211 rad to the right "
        "at most",
        "my.txt:5:5: line 5 asks for 0.5 rad; the mushr_nano steers 0.3158 rad to the left at most",
        "my.txt:6:1: line 6 asks for -1 m/s; the mushr_nano does 0.9286 m/s in reverse at most",
    ]
    assert not faults(text, "ideal")
    (fault,) = faults("0,0,0\n0.5,0.3,1\n0.5,-0.3,1\n", "racecar_mit")
    assert fault.startswith("my.txt:3:5: line 3 asks for -0.3 rad; the racecar_mit steers 0.26")


@pytest.mark.parametrize(
    "rows, car",
    [
        ("0.9286,0.3158,1\n-0.9286,-0.4211,2\n", "mushr_nano"),  # the limits themselves
        ("0.5,0.3,1\n0.5,-0.2,1\n", "racecar_mit"),  # 0.35 to the left, 0.26 to the right
        ("0.5,0.3,0.13\n0.25,0,0.1\n0,0,0.1\n", "mushr_nano"),  # 0.5 m/s in 0.129 s
    ],
)
def test_plans_within_the_limits(rows, car):
    assert not faults("0,0,0\n" + rows, car)


def test_a_plan_is_slowed_down_with_a_fault_for_each_run_of_rows():
    plan = plan_of("0,0,0\n# slow\n0.5, 0.1\n 2, 0\n-3, 0.2, 0.5\n-1, 0\n1.5,0\n")
    slow, changes = slowed(plan, 1.0)
    assert [row.speed for row in slow.rows] == [0.5, 1.0, -1.0, -1.0, 1.0]
    assert [row[1:] for row in slow.rows] == [row[1:] for row in plan.rows]
    assert (slow.path, slow.start) == (plan.path, plan.start)
    assert [str(each) for each in changes] == [
        "my.txt:4:2: lines 4 to 5 ask for 2 to -3 m/s; the largest speed allowed is 1 m/s, "
        "which replaces it",
        "my.txt:7:1: line 7 asks for 1.5 m/s; the largest speed allowed is 1 m/s, "
        "which replaces it",
    ]
    assert slowed(plan, math.inf) == (plan, [])
    at_the_limit = plan_of("0,0,0\n0.3,0\n")  # 0.3 rounds up as a float32
    assert slowed(at_the_limit, 0.3) == (at_the_limit, [])


def test_a_heading_in_degrees():
    (fault,) = faults("0,0,45\n1,0\n")
    assert fault == "my.txt:1:5: theta is more than a full turn; expected radians, not degrees"
    assert faults("0,0,-6.28\n1,0\n") == []


def test_ramps_that_do_not_fit_into_their_rows():
    assert faults("0,0,0\n0.5,0,0.1\n0.5,0,0.2\n0.5,-0.4,0.1\n", "mushr_nano") == [
        "my.txt:2:1: line 2 is too short: the mushr_nano needs 0.129 s from 0 to 0.5 m/s at "
        "3.8889 m/s^2, and line 2 lasts 0.1 s",
        "my.txt:4:5: line 4 is too short: the mushr_nano needs 0.125 s from 0 to -0.4 rad at "
        "3.2 rad/s, and line 4 lasts 0.1 s",
    ]


def test_a_wall_ahead():
    """The body ends 0.38 m before the rear axle, and the wall is at 5 m."""
    report = checked("0,0,0\n1, 0\n2, 0, 9\n", grid=walled())
    (fault,) = report.faults
    assert str(fault) == "my.txt:3:1: the car hits a wall at t = 2.8 s, (4.6, 0.0); it stops there"
    assert report.collision.pose == pytest.approx(
        (4.62, 0.0, 0.0), abs=1e-8
    )  # [m] walls are to 1e-9


def test_the_report_ends_at_the_wall():
    report = checked("0,0,0\n1, 0\n-1, 0.2\n2, 0, 9\n0, 0\n", grid=walled(1.0))
    assert report.final_pose == pytest.approx(report.collision.pose, abs=1e-8)
    assert report.length == pytest.approx(0.62, abs=1e-8)
    assert report.box == pytest.approx((0.0, 0.62, 0.0, 0.0), abs=1e-8)
    text = list(as_text(report, spread(report.plan, Car(), 2, 1)))
    assert text[1:3] == [str(report.faults[0]), "1 fault"]
    assert "    ... 3 more rows, not driven ..." in text
    assert "duration        0.62 of 12 s" in text
    assert "ends at rest    no, a wall ends the drive" in text
    assert "  walls           ignored" in text
    assert len(report.steps) == 1


def test_the_faults_of_rows_after_a_wall():
    text = "0,0,0\n0.5, 0, 20\n0, 0, 1\n0.5, 0, 0.1\n"
    _, *others = faults(text, "mushr_nano", walled())
    assert others == faults(text, "mushr_nano") != []


@pytest.mark.parametrize("car_name", ["ideal", "mushr_nano"])
@pytest.mark.parametrize(
    "rows",
    [
        "1, 0.2, 2\n1.5, -0.3, 9",
        "-0.8, 0.1, 9",
        "0.9, 0.2, 3\n0.9, 0.05, 0.35\n-0.9, 0.4, 2\n0.7, 0.1, 20",
    ],
)
def test_a_wall_is_hit_where_the_simulated_car_hits_it(rows, car_name):
    grid, car = walled(), CARS[car_name]
    report = checked(f"0, 0, 0.3\n{rows}\n", car_name, grid)
    trajectory = prediction.trajectory(report.plan, car, World(grid))
    contact = next(state.collision for state in trajectory if state.collision)
    assert report.collision.pose == pytest.approx(contact.pose, abs=1e-7)  # [m] a nudge at most
    (fault,) = (each for each in report.faults if "wall" in each.text)
    assert f"t = {contact.stamp / 1e9:.1f} s" in fault.text


@pytest.mark.parametrize("car", ["ideal", "mushr_nano"])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.1, -0.3, -0.6])
def test_a_row_of_years_hits_the_same_walls_as_a_row_of_a_minute(angle, car):
    """It takes no longer to check, because a full circle has no new points."""
    years = faults(f"0,0,0\n0.5, {angle}, 1e9\n", car, walled())
    assert years == faults(f"0,0,0\n0.5, {angle}, 60\n", car, walled())
    assert any("hits a wall" in each for each in years) == (angle != -0.6)


def test_rolling_on_into_a_wall():
    report = checked("0,0,0\n0.9, 0, 5.19\n", "mushr_nano", walled(5.0))
    (fault,) = report.faults
    assert fault.line == 2
    assert "the car, rolling on after the last row, hits a wall at t = 5.3 s" in fault.text
    assert "duration        5.19 s" in list(as_text(report))


def test_start_poses_in_a_wall_or_off_the_map():
    (fault,) = faults("\n# c\n 4.8,0,0\n1,0\n", grid=walled())
    assert fault == "my.txt:3:2: the start pose is in a wall, at least in part"
    (fault,) = faults("40,0,0\n1,0\n", grid=walled())
    assert fault == "my.txt:1:1: the start pose is off the map, at least in part"


FREE = Grid(np.zeros((80, 80), np.int8), 0.1, Pose(-4.0, -4.0, 0.0))
"""A map without walls, from -4 m to 4 m."""


@pytest.mark.parametrize(
    "heading, where",
    [
        (0.0, "(3.6, 0.0)"),
        (0.5 * math.pi, "(0.0, 3.6)"),
        (math.pi, "(-3.6, 0.0)"),
        (-0.5 * math.pi, "(0.0, -3.6)"),
    ],
)
def test_the_car_leaves_the_map(heading, where):
    """The body ends 0.38 m before the rear axle."""
    assert faults(f"0,0,{heading}\n1,0,2\n0,0\n1,0,9\n", grid=FREE) == [
        f"my.txt:4:1: the car leaves the map at t = 4.6 s, {where}"
    ]


def test_the_car_leaves_a_turned_map_in_reverse():
    """The tail ends 0.06 m behind the rear axle."""
    turned = Grid(np.zeros((40, 80), np.int8), 0.1, Pose(2.0, -4.0, 0.5 * math.pi))
    report = checked("0,0,1.5707963\n-1,0,9\n", grid=turned)
    (fault,) = report.faults
    assert fault.text == "the car leaves the map at t = 3.9 s, (0.0, -3.9)"
    assert report.collision is None


def test_straight_line_twice_hits_the_wall_of_the_sandbox():
    rows = "2,0\n3,0\n4,0\n5,0\n6,0\n6,0\n6,0\n5,0\n4,0\n3,0\n2,0\n"
    grid = read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml"))
    assert not faults("0,0,0\n" + rows, grid=grid)
    assert not faults("0,0,0\n" + rows + rows)
    (fault,) = faults("0,0,0\n" + rows + rows, grid=grid)
    assert fault.startswith("my.txt:14:1: the car hits a wall at t = 12.3 s, (49.0, 0.0)")


def test_the_text_on_the_spread():
    report = checked("0,0,0\n1,0,2\n")
    result = spread(report.plan, Car(speed_noise=0.1), 50, 3)
    text = list(as_text(report, result))
    assert any("50 runs, seed 3" in line for line in text)
    assert "  every command   speed 0.1 m/s, steering 0 rad" in text
    mean, deviation, last = text[-3:]
    for line, values in ((mean, result.poses.mean(0)), (deviation, result.poses.std(0))):
        shown = [float(each) for each in re.findall(r"-?\d+\.\d+", line)]
        assert shown == pytest.approx(values, abs=6e-4)
    off = sorted(math.dist(each[:2], (2.0, 0.0)) for each in result.poses)
    rms, share, inner = (float(each) for each in re.findall(r"\d+\.\d+", last))
    assert rms == pytest.approx(math.sqrt(sum(each**2 for each in off) / 50), abs=6e-4)
    assert share == pytest.approx(100.0 * rms / 2.0, abs=0.1)
    assert off[46] - 6e-4 <= inner <= off[47] + 6e-4  # 47.5 of 50
    text = list(as_text(report, spread(report.plan, Car(), 2, 1)))
    assert "  the ideal car has no errors, so all runs end in the same place" in text


def test_the_mean_heading_is_shown_as_the_final_one():
    """From -pi to pi."""
    report = checked("0,0,3.1\n1,0.2,1\n")
    text = list(as_text(report, spread(report.plan, Car(steering_noise=0.01), 50, 3)))
    shown = [re.search(r"theta (-?[\d.]+) rad", each)[1] for each in text if "theta -" in each]
    assert len(shown) == 2 and float(shown[0]) == pytest.approx(float(shown[1]), abs=0.05)


@pytest.fixture(name="run")
def _run(monkeypatch, capsys, tmp_path):
    """Return a function that runs the program in a folder; it returns (status, output, errors)."""

    def run(*arguments, folder=tmp_path):
        monkeypatch.setattr("signal.signal", lambda *_: None)  # SIGPIPE would end pytest
        monkeypatch.chdir(folder)
        monkeypatch.setenv("PWD", str(folder))
        monkeypatch.setattr(sys, "argv", ["check_plan.py", *arguments])
        try:
            status = exit_status("check_plan.py", check_plan.run)
        except SystemExit as end:
            status = end.code
        return (status, *capsys.readouterr())

    return run


def test_a_plan_without_faults_ends_with_status_0():
    with Process(PROGRAM, "figure_8", "--map", "sandbox") as result:
        assert result.wait() == 0
    first = result.output.split("\n")[0]
    assert "plans/figure_8.txt: 22 rows, on the ideal car, on the map " in first
    assert result.output.split("\n")[1] == "no faults"


def test_no_map_has_a_name(run):
    """The same name as in sim.launch and grade.py."""
    assert run("circle", "--map", "none") == run("circle")
    assert run("circle")[0] == 0


def test_interrupted(run, monkeypatch):
    """Ctrl-C ends a long computation without a traceback."""

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(check_plan, "spread", interrupt)
    assert run("figure_8", "--car", "mushr_nano", "--runs", "9") == (130, "", "")


def test_one_plan_with_faults_among_others_ends_with_status_1(run, tmp_path):
    (tmp_path / "fast.txt").write_text("0,0,0\n0.5,0\n6.6,0\n")
    status, output, errors = run("circle", "fast.txt", "--car=mushr_tx2")
    assert (status, errors) == (1, "")
    assert "circle.txt: 1 row, on the mushr_tx2 car\n" in output
    assert "\nfast.txt:3:1: line 3 asks for 6.6 m/s; the mushr_tx2 does 1.625 m/s" in output


def test_every_fault_of_broken_plans_is_printed(run):
    paths = [os.path.join(FIXTURES, "broken_plans", name) for name in BROKEN]
    status, output, errors = run(*paths)
    assert (status, errors) == (1, "")
    for path, part in zip(paths, output.split("\n\n")):
        with pytest.raises(PlanError) as caught:
            read_plan(path)
        count = len(caught.value.faults)
        assert part.strip() == f"{caught.value}\n" + ("1 fault" if count == 1 else "7 faults")


@pytest.mark.parametrize(
    "arguments, text",
    [
        ([], "the following arguments are required: PLAN"),
        (["circle", "figure_9"], "figure_9: no such file; did you mean figure_8? (searched: "),
        (["circle", "--map", "moon"], "moon: no such file (searched: "),
        (["circle", "--map", os.path.join(PACKAGE, "package.xml")], "expected a map's yaml file"),
        (["circle", "--runs", "1"], "--runs is '1'; expected a whole number from 2 to 100000"),
        (["circle", "--seed", "-1"], "--seed is '-1'; expected a whole number from 0"),
        (["circle", "slalom", "--plot", "a.png"], "--plot draws one plan; expected one PLAN"),
        (["circle", "--plot", "/nowhere/a.png"], "cannot be written: No such file or directory"),
        (["circle", "--plot", "a.mp3"], "expected a name such as figure_8.png"),
        (["circle", "--plot", "folder"], "folder cannot be written: Is a directory; expected a na"),
    ],
)
def test_bad_usage_ends_with_status_2(run, arguments, text, tmp_path):
    (tmp_path / "folder").mkdir()
    status, _, errors = run(*arguments)
    assert status == 2
    assert text in errors


def test_the_same_seed_gives_the_same_output(run):
    arguments = ("slalom", "--car", "mushr_nano", "--runs", "500", "--seed")
    _, outputs, _ = zip(*(run(*arguments, seed) for seed in ("1", "1", "2")))
    assert outputs[0] == outputs[1] != outputs[2]
    assert "500 runs, seed 1" in outputs[0]


def test_plot(run, tmp_path):
    options = ("--plot=out.png", "--map=race_loop", "--car=mushr_nano", "--runs=200")
    status, _, errors = run("slalom", *options)
    assert (status, errors) == (1, "")
    assert "no faults" in run("circle", "--plot=out.mp3")[1]
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_the_drawing():
    grid, name = walled(3.0), "mushr_nano"
    report = check(plan_named("slalom")._replace(path="a$x^$.txt"), name, CARS[name], "m", grid)
    car = Car(steering_noise=0.05, speed_gain_spread=0.02, steering_offset_spread=0.01)
    result = spread(report.plan, car, 500, 1)
    figure = draw_report(report, result, grid)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes, key, speed, angle = figure.axes
    assert axes.get_title() == r"a\$x^\$.txt on the mushr_nano car: 2.72 m, 2 faults"
    # The order depends on the version of matplotlib.
    assert sorted(text.get_text() for text in key.get_legend().get_texts()) == [
        *("final pose of a run, without walls", "heading between two rows"),
        *("predicted end", "predicted path", "predicted start"),
        *("the car hits a wall", "wall"),
    ]
    assert key.get_legend().get_window_extent().y1 < axes.bbox.y0
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    low, high = axes.dataLim.get_points()
    space = [*(low - (left, bottom)), *((right, top) - high)]
    assert min(space) >= 0.5  # [m] of margin
    assert space[:2] == pytest.approx(space[2:])  # in the middle
    assert axes.images[0].zorder < min(line.zorder for line in axes.lines if len(line.get_xdata()))
    pixels = np.asarray(canvas.buffer_rgba())[::-1, :, 0]
    columns, rows = axes.transData.transform([(3.07, 1.73), (2.93, 1.73)]).astype(int).T
    assert pixels[rows, columns].tolist() == [0, 255]  # in the wall, and beside it
    runs, arrows = (each for each in axes.collections if isinstance(each, Quiver))
    assert [*axes.lines[0].get_xdata()] == [*result.poses[:, 0]] and len(runs.U) == 100
    headings = [report.plan.start.theta, *(step.pose.theta for step in report.steps)]
    assert np.arctan2(arrows.V, arrows.U) == pytest.approx(np.array(headings))
    assert speed.get_xlim() == angle.get_xlim()
    for panel, field in ((speed, "speed"), (angle, "steering_angle")):
        predicted, commanded = panel.lines[:2]
        assert [*predicted.get_ydata()] == [getattr(state, field) for state in report.states]
        assert commanded.get_ydata()[-1] == getattr(report.plan.rows[len(report.steps) - 1], field)


def test_the_legend_has_what_is_drawn():
    report = report_on("circle")
    _, key, *_ = draw_report(report, spread(report.plan, report.car, 2, 1), None).axes
    assert [text.get_text() for text in key.get_legend().get_texts()] == [
        *("predicted path", "predicted start", "predicted end", "heading between two rows"),
    ]
    # Less than half of a cell of the nearest wall is visible.
    sandbox = read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml"))
    _, key, *_ = draw_report(report_on("figure_8"), None, sandbox).axes
    assert "wall" not in [text.get_text() for text in key.get_legend().get_texts()]
