"""Test which commands pass the mux, and which configurations it accepts."""

import copy
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.simulator.mux import IDLE, Config, Input, Mux, full_topic, parse_config

MS = 1_000_000
"""[ns]"""

BEGIN = 1_700_000_000_000 * MS
"""The instant 0 [ns]."""

TELEOP = Input("teleop", "input/teleop", 200 * MS, 5)
PLAN = Input("plan", "input/plan", 300 * MS, 1)


class Drive:
    """A mux, and what it sends: the speed of a command, or "stop" with its stamp [ms].

    Times count from 1e12 ms.
    """

    def __init__(self, is_simulated=True, wall=math.inf):
        self.warnings, self.sent, self.wall = [], [], wall
        self.mux = Mux(is_simulated, self.warnings.append)

    def send(self, source, stamp, speed=0.0, arrival=None):
        """Send a command that arrives at its stamp or at another instant [ms]; None: no stamp."""
        now = stamp if arrival is None else arrival
        sent = 0 if stamp is None else BEGIN + stamp * MS
        stop, passes = self.mux.add(source, sent, BEGIN + now * MS, self.wall)
        self._stop(stop)
        self.sent += [speed] * passes
        return passes

    def advance(self, until):
        """Advance the clock to an instant [ms]."""
        self._stop(self.mux.expire(BEGIN + until * MS, self.wall))

    def _stop(self, stamp):
        if stamp is not None:
            self.sent.append(("stop", (stamp - BEGIN) // MS if stamp else None))


def after(*commands):
    """Return a drive after commands of (input, stamp [ms]), and which of them passed."""
    drive = Drive()
    return drive, [drive.send(*each) for each in commands]


def deadline(drive):
    """Return when the last live input expires [ms]."""
    return (drive.mux.deadline - BEGIN) // MS


@pytest.mark.parametrize(
    ("topic", "expected"),
    [("/cmd", "/cmd"), ("input/a", "/m/input/a"), ("~a", "/m/a"), ("~/a", "/m/a")],
)
def test_names_of_topics(topic, expected):
    assert full_topic("/m", topic) == expected


def test_the_higher_priority_takes_over_and_holds_until_its_timeout():
    for stamp, expected in ((10, False), (209, False), (210, True), (299, True)):
        drive, verdicts = after((PLAN, 0), (TELEOP, 10), (PLAN, stamp))
        assert verdicts == [True, True, expected]
        assert drive.mux.active == ("plan" if expected else "teleop")


@pytest.mark.parametrize("late", [0, 7])
def test_the_car_stops_when_the_last_live_input_expires(late):
    drive, _ = after((TELEOP, 100), (PLAN, 150))
    assert deadline(drive) == 450  # the plan's, though it does not drive
    drive.advance(449)
    assert drive.sent == [0.0]
    drive.advance(450 + late)
    assert drive.sent == [0.0, ("stop", 450)]
    assert drive.mux.active == IDLE and drive.mux.deadline is None
    drive.advance(900)
    assert len(drive.sent) == 2  # there is no second stop


def test_the_stop_comes_before_a_command_that_is_later():
    drive, _ = after((TELEOP, 0), (PLAN, 201))
    assert drive.sent == [0.0, ("stop", 200), 0.0]
    assert drive.mux.active == "plan" and deadline(drive) == 501


def test_a_clock_that_is_set_back_lets_all_inputs_expire():
    drive, _ = after((TELEOP, 5000), (PLAN, 5000))
    assert drive.send(PLAN, 3900) and len(drive.warnings) == 1
    drive.advance(4200)
    assert drive.sent[-1] == ("stop", 4200)


@pytest.mark.parametrize("is_simulated", [True, False])
def test_a_command_without_a_stamp(is_simulated):
    """Its stop has no stamp either; in simulated time, the mux may learn the time late."""
    drive = Drive(is_simulated)
    assert drive.send(TELEOP, None, arrival=0)
    assert deadline(drive) == (400 if is_simulated else 200)
    drive.advance(deadline(drive))
    assert drive.sent[-1] == ("stop", None)


def test_a_command_without_a_stamp_does_not_expire_at_once():
    """Although the clock advances at once: its timeout also holds in wall-clock time."""
    drive = Drive(wall=50.0)
    drive.send(TELEOP, None, arrival=0)
    drive.wall = 50.1
    drive.advance(900)
    assert drive.sent == [0.0] and drive.mux.held(50.1) == pytest.approx(0.1)
    drive.wall = 50.21
    drive.advance(900)
    assert drive.sent == [0.0, ("stop", None)]


def test_a_sender_whose_clock_is_late():
    """In wall-clock time, its input is live while its commands arrive."""
    drive = Drive(is_simulated=False)
    for arrival in range(1000, 2600, 199):
        drive.advance(arrival)
        assert drive.send(TELEOP, arrival - 600, arrival=arrival)
        assert not drive.send(PLAN, arrival)
    drive.advance(2892)
    assert drive.sent == [0.0] * 9 + [("stop", None)]


def test_a_sender_whose_clock_is_early():
    """In wall-clock time, it takes over at once, without a stop, and holds the car longer."""
    drive = Drive(is_simulated=False)
    drive.send(PLAN, 0)
    assert drive.send(TELEOP, 600, arrival=10)
    assert not drive.send(PLAN, 799)
    drive.advance(1098)
    assert drive.sent == [0.0, 0.0] and drive.mux.active == "teleop"
    drive.advance(1099)  # that of the plan has expired, too
    assert drive.sent == [0.0, 0.0, ("stop", None)]


@given(st.lists(st.tuples(st.sampled_from([TELEOP, PLAN]), st.integers(0, 100)), max_size=20))
def test_in_order_a_command_passes_unless_a_higher_one_is_live(steps):
    drive, now, last = Drive(), 0, {}
    for source, pause in steps:
        now += pause * 10
        due = max((last[each] + each.timeout // MS for each in last), default=None)
        before = len(drive.sent)
        drive.advance(now)
        if due is not None and now >= due:
            assert drive.sent[before:] == [("stop", due)]
            last = {}
        else:
            assert len(drive.sent) == before
        blocked = source is PLAN and TELEOP in last and now < last[TELEOP] + TELEOP.timeout // MS
        assert drive.send(source, now) is not blocked
        assert drive.mux.active == ("teleop" if blocked else source.name)
        last[source] = now


KEYS = {"topic": "input/teleop", "timeout": 0.2, "priority": 5.0, "short_desc": "keys"}
GOOD = {
    "subscribers": [
        {"name": "plan", "topic": "input/plan", "timeout": 0.3, "priority": 1},
        {"name": "teleop", **KEYS},
    ],
    "publisher": "output",
}

MISSING = object()
NAN, INF = float("nan"), float("inf")


def test_inputs_are_sorted_by_priority():
    assert parse_config(GOOD) == Config((TELEOP, PLAN), "output")


@pytest.mark.parametrize(
    "key, value, expected",
    [
        ("name", MISSING, "~subscribers[1]/name is not set; expected a name"),
        ("name", "", "~subscribers[1]/name is ''; expected a name"),
        ("name", 3, "~subscribers[1]/name is 3; expected a name"),
        ("name", "idle", "~subscribers[1]/name is 'idle'; expected another name"),
        ("name", "teleop", "inputs 'teleop' and 'teleop' share the name 'teleop'; expected each"),
        ("topic", MISSING, "~subscribers[1]/topic is not set; expected a topic"),
        ("topic", ["a"], "~subscribers[1]/topic is ['a']; expected a topic"),
        ("topic", "input/teleop", "inputs 'plan' and 'teleop' share the topic 'input/teleop'; exp"),
        ("topic", "output", "~publisher is 'output'; expected another topic than those of the inp"),
        ("timeout", MISSING, "~subscribers[1]/timeout is not set; expected a number from 1e-09 to"),
        ("timeout", 0, "~subscribers[1]/timeout is 0; expected a number from 1e-09 to 1e+06 s"),
        ("timeout", 2e6, "~subscribers[1]/timeout is 2000000.0; expected a number from 1e-09 to"),
        ("priority", MISSING, "~subscribers[1]/priority is not set; expected a whole number from"),
        ("priority", 1.5, "~subscribers[1]/priority is 1.5; expected a whole number"),
        ("priority", 5, "inputs 'plan' and 'teleop' share the priority 5; expected each input"),
        ("speed", 1, "~subscribers[1]/speed is 1; expected only the keys name, topic, timeout, pr"),
    ],
)
def test_bad_input(key, value, expected):
    raw = copy.deepcopy(GOOD)
    raw["subscribers"][0].pop(key, None)
    if value is not MISSING:
        raw["subscribers"][0][key] = value
    with pytest.raises(UserError) as caught:
        parse_config(raw)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    "raw, expected",
    [
        (None, "~ is None; expected only the keys publisher, subscribers"),
        ([], "~ is []; expected only the keys publisher, subscribers"),
        ({}, "~publisher is not set; expected a topic"),
        (dict(GOOD, subscribers=[]), "~subscribers is []; expected a list of inputs"),
        (dict(GOOD, subscribers={"a": 1}), "~subscribers is {'a': 1}; expected a list of inputs"),
        (dict(GOOD, subscribers=["a"]), "~subscribers[1]/ is 'a'; expected only the keys name,"),
        (dict(GOOD, publisher=7), "~publisher is 7; expected a topic"),
        (dict(GOOD, output="x"), "~output is 'x'; expected only the keys publisher, subscribers"),
    ],
)
def test_bad_configuration(raw, expected):
    with pytest.raises(UserError) as caught:
        parse_config(raw)
    assert expected in str(caught.value)
