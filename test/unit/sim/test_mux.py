"""The mux: which configurations it takes, and who drives when."""

import copy

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.sim.mux import (
    IDLE,
    Config,
    ConfigError,
    Input,
    Mux,
    TakeoverMonitor,
    parse_config,
    sent_at,
)
from mushr_ros_intro.sim.stamps import CLOCK_LAG, STAMP_TOLERANCE

MS = 1_000_000
"""[ns]"""

TELEOP = Input("teleop", "input/teleop", 200 * MS, 5, "keys")
PLAN = Input("plan", "input/plan", 300 * MS, 1, "")

GOOD = {
    "subscribers": [
        {"name": "plan", "topic": "input/plan", "timeout": 0.3, "priority": 1},
        {
            "name": "teleop",
            "topic": "input/teleop",
            "timeout": 0.2,
            "priority": 5.0,
            "short_desc": "keys",
        },
    ],
    "publisher": "output",
}

MISSING = object()


def test_inputs_stand_by_falling_priority():
    assert parse_config(GOOD) == Config((TELEOP, PLAN), "output")


@pytest.mark.parametrize(
    "key, value, expected",
    [
        ("name", MISSING, "subscribers[1] lacks the key 'name'; expected a name"),
        ("name", "", "subscribers[1] has '' for the key 'name'; expected a name"),
        ("name", 3, "subscribers[1] has 3 for the key 'name'; expected a name"),
        ("name", "idle", "subscribers[1] has the name 'idle', which means that none is; expected"),
        ("name", "teleop", "inputs 'teleop' and 'teleop' share the name 'teleop'"),
        ("topic", MISSING, "subscribers[1] lacks the key 'topic'; expected a name"),
        ("topic", ["a"], "subscribers[1] has ['a'] for the key 'topic'; expected a name"),
        ("topic", "input/teleop", "inputs 'plan' and 'teleop' share the topic 'input/teleop'"),
        ("topic", "output", "input 'plan' has the topic 'output' of the key 'publisher'"),
        ("timeout", MISSING, "subscribers[1] lacks the key 'timeout'; expected a number"),
        ("timeout", "0.2", "subscribers[1] has '0.2' for the key 'timeout'; expected a number"),
        ("timeout", 0, "subscribers[1] has the timeout 0; expected seconds, 1e-9 to 1e6"),
        ("timeout", -1.0, "subscribers[1] has the timeout -1.0; expected seconds, 1e-9 to 1e6"),
        ("timeout", 2e6, "subscribers[1] has the timeout 2000000.0; expected seconds, 1e-9 to 1e6"),
        (
            "timeout",
            float("nan"),
            "subscribers[1] has nan for the key 'timeout'; expected a number",
        ),
        (
            "timeout",
            float("inf"),
            "subscribers[1] has inf for the key 'timeout'; expected a number",
        ),
        ("priority", MISSING, "subscribers[1] lacks the key 'priority'; expected a number"),
        ("priority", True, "subscribers[1] has True for the key 'priority'; expected a number"),
        ("priority", 1.5, "subscribers[1] has the priority 1.5; expected a whole number"),
        ("priority", 5, "inputs 'plan' and 'teleop' share the priority 5; expected each input"),
        ("speed", 1, "subscribers[1] has the unknown key 'speed'; expected only name, topic,"),
    ],
)
def test_bad_input(key, value, expected):
    raw = copy.deepcopy(GOOD)
    raw["subscribers"][0].pop(key, None)
    if value is not MISSING:
        raw["subscribers"][0][key] = value
    with pytest.raises(ConfigError) as caught:
        parse_config(raw)
    assert str(caught.value).startswith(expected) and "; expected" in str(caught.value)


@pytest.mark.parametrize(
    "raw, expected",
    [
        (None, ["is None; expected the keys 'subscribers' and 'publisher'"]),
        ([], ["is []; expected the keys 'subscribers' and 'publisher'"]),
        ({}, ["lacks the key 'publisher'", "'subscribers' is missing or empty"]),
        (dict(GOOD, subscribers=[]), ["'subscribers' is missing or empty"]),
        (dict(GOOD, subscribers={"a": 1}), ["'subscribers' is missing or empty"]),
        (dict(GOOD, subscribers=["teleop"]), ["subscribers[1] is 'teleop'; expected name, topic"]),
        (dict(GOOD, publisher=7), ["has 7 for the key 'publisher'"]),
        (dict(GOOD, output="x"), ["unknown key 'output'; expected only 'subscribers' and"]),
        (dict(GOOD, subscribers=[{}, 3]), ["subscribers[1] lacks the key 'name'", "[2] is 3"]),
    ],
)
def test_bad_configuration_gets_every_fault(raw, expected):
    with pytest.raises(ConfigError) as caught:
        parse_config(raw)
    for each in expected:
        assert each in str(caught.value)


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3)
keys = scalars | st.sampled_from(["name", "topic", "timeout", "priority", "subscribers"])
structures = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=5),
    max_leaves=10,
)


@given(structures, structures, st.dictionaries(keys, structures, max_size=4))
def test_any_configuration_is_read_or_refused(raw, publisher, entry):
    plausible = dict(GOOD["subscribers"][0], **{str(key): value for key, value in entry.items()})
    for each in (raw, {"subscribers": [plausible, raw], "publisher": publisher}):
        try:
            assert parse_config(each).inputs
        except ConfigError as error:
            assert str(error)


scraps = ["subscribers:", "publisher:", "name:", "topic:", "timeout:", "priority:", "short_desc:"]
scraps += [
    "\n",
    "\n  - ",
    "\n    ",
    " a",
    " a/b",
    " 0.2",
    " .nan",
    " 1e400",
    " -1",
    " 9",
    " [",
    " {",
]
scraps += ["]", "}", ",", " &a", " *a", " !!int", " |", "'", " ~", " yes", " 1:30", " 0x1f", "#"]


@given(
    st.binary(max_size=60) | st.lists(st.sampled_from(scraps)).map(lambda e: "".join(e).encode())
)
def test_any_yaml_is_a_configuration_or_refused(data):
    try:
        raw = yaml.safe_load(data)
    except Exception:
        return  # it is roslaunch that reads the file, and says so
    try:
        assert parse_config(raw).inputs
    except ConfigError as error:
        assert "expected" in str(error)


def passed(*commands):
    """Feed commands of (input, stamp [ms]) to a new mux; return it, and which of them passed."""
    mux, verdicts = Mux(), []
    for source, stamp in commands:
        mux, passes = mux.command(source, stamp * MS)
        verdicts.append(passes)
    return mux, verdicts


def test_nobody_drives_at_first():
    assert Mux().active == IDLE and Mux().deadline is None
    assert Mux().expire(10**18) == (Mux(), None)


def test_the_higher_priority_takes_over_and_holds_until_its_timeout():
    for stamp, expected in ((10, False), (209, False), (210, True), (500, True)):
        mux, verdicts = passed((PLAN, 0), (TELEOP, 10), (PLAN, stamp))
        assert verdicts == [True, True, expected]
        assert mux.active == ("plan" if expected else "teleop")


def test_the_lower_priority_stops_nobody():
    mux, verdicts = passed((PLAN, 0), (TELEOP, 0), (PLAN, 1), (TELEOP, 2))
    assert verdicts == [True, True, False, True]
    assert mux.active == "teleop"


def test_the_car_stops_when_the_last_live_input_runs_out():
    mux, _ = passed((TELEOP, 100), (PLAN, 150))
    assert mux.deadline == 450 * MS  # the plan's, though it does not drive
    assert mux.expire(450 * MS - 1) == (mux, None)
    for late in (0, 7 * MS):
        after, stop = mux.expire(450 * MS + late)
        assert stop == 450 * MS and after.active == IDLE and after.deadline is None


def test_a_late_command_does_not_shorten_what_a_younger_one_holds():
    mux, verdicts = passed((TELEOP, 100), (TELEOP, 50))
    assert verdicts == [True, True] and mux.deadline == 300 * MS
    assert passed((TELEOP, 100), (TELEOP, 50), (PLAN, 299))[1][-1] is False


NOW = 1_700_000_000_000_000_000


@pytest.mark.parametrize("off", [0, STAMP_TOLERANCE, -STAMP_TOLERANCE])
@pytest.mark.parametrize("is_simulated", [False, True])
def test_a_command_was_sent_when_its_stamp_says(off, is_simulated):
    assert sent_at(NOW + off, NOW, 200 * MS, is_simulated) == (NOW + off, 0)


@pytest.mark.parametrize("off", [STAMP_TOLERANCE + 1, CLOCK_LAG, -STAMP_TOLERANCE - 1, -CLOCK_LAG])
def test_only_in_simulated_time_is_a_clock_that_is_behind_believed_to_be(off):
    assert sent_at(NOW + off, NOW, 200 * MS, is_simulated=True) == (NOW + off, 0)
    assert sent_at(NOW + off, NOW, 200 * MS, is_simulated=False) == (NOW, 0)


@pytest.mark.parametrize("stamp", [0, NOW + CLOCK_LAG + 1, NOW - CLOCK_LAG - 1])
def test_a_stamp_that_says_nothing_means_a_simulated_present_that_may_be_old(stamp):
    """So the command is good for twice its timeout."""
    assert sent_at(stamp, NOW, 200 * MS, is_simulated=True) == (NOW, 200 * MS)
    assert sent_at(stamp, NOW, 200 * MS, is_simulated=False) == (NOW, 0)


def test_before_the_clock_has_come_a_stamp_of_zero_says_nothing_either():
    assert sent_at(0, 0, 200 * MS, is_simulated=True) == (0, 200 * MS)


def test_a_command_of_which_the_time_is_a_guess_is_good_for_longer():
    mux, passes = Mux().command(TELEOP, 100 * MS, slack=50 * MS)
    assert passes and mux.deadline == 350 * MS


def test_after_a_stop_it_begins_afresh():
    mux, _ = passed((TELEOP, 0))
    mux, _ = mux.expire(200 * MS)
    mux, passes = mux.command(PLAN, 201 * MS)
    assert passes and mux.active == "plan" and mux.deadline == 501 * MS


def test_restart_lets_all_inputs_run_out_at_once():
    mux, _ = passed((TELEOP, 5000), (PLAN, 5000))
    mux = mux.restart(100 * MS)
    assert mux.deadline == 100 * MS
    assert mux.command(PLAN, 100 * MS)[1] is True
    assert mux.expire(100 * MS) == (Mux(), 100 * MS)
    assert Mux().restart(0) == Mux()


@given(st.lists(st.tuples(st.sampled_from([TELEOP, PLAN]), st.integers(0, 100)), max_size=20))
def test_in_order_a_command_passes_unless_a_higher_one_is_live(steps):
    mux, now, last = Mux(), 10**9, {}
    for source, pause in steps:
        now += pause * 10 * MS
        mux, stop = mux.expire(now)
        due = max((last[each] + each.timeout for each in last), default=None)
        if due is not None and now >= due:
            assert stop == due
            last = {}
        else:
            assert stop is None
        mux, passes = mux.command(source, now)
        blocked = source is PLAN and now < last.get(TELEOP, 0) + TELEOP.timeout
        assert passes is not blocked
        assert mux.active == ("teleop" if blocked else source.name)
        last[source] = now


@pytest.mark.parametrize(
    "names, lost_to",
    [
        ("idle navigation", ""),
        ("Default Navigation", ""),  # MuSHR's; it gets stops by default, six a second
        ("idle Default idle", ""),
        ("idle teleop", "teleop"),
        ("Teleoperation", "Teleoperation"),
        ("navigation teleop idle navigation", "teleop"),  # and it does not come back
        ("Navigation Safety", "Safety"),
        ("navigation idle", "idle"),
        ("Navigation Default", "Default"),
        ("navigation ", "idle"),
    ],
)
def test_when_the_car_is_lost(names, lost_to):
    watch = TakeoverMonitor("navigation")
    for name in names.split(" "):
        watch = watch.hear(name, is_sending=True)
    assert watch.lost_to == lost_to


def test_a_car_that_another_plan_had_is_not_lost():
    watch = (
        TakeoverMonitor("navigation")
        .hear("navigation", is_sending=False)
        .hear("idle", is_sending=False)
    )
    assert not watch.lost_to
    assert watch.hear("navigation", is_sending=True).hear("idle", is_sending=True).lost_to


def test_a_car_that_was_had_can_be_lost_after_a_pause():
    watch = TakeoverMonitor("navigation").hear("navigation", is_sending=True)
    watch = watch.hear("navigation", is_sending=False)
    assert watch.hear(" \n", is_sending=False).lost_to == "idle"


def test_a_name_is_known_however_it_is_written():
    assert TakeoverMonitor("Navigation").hear(" navigation\n", is_sending=True).had
