"""Test which commands pass the mux, and which configurations it accepts."""

import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.simulator.mux import IDLE, Config, Input, Mux, full_topic, parse_config

MS = 1_000_000
"""[ns]"""

TELEOP = Input("teleop", "input/teleop", 200 * MS, 5)
PLAN = Input("plan", "input/plan", 300 * MS, 1)


def command(mux, source, instant):
    """Feed a command, which expires after the timeout of its input, to a mux."""
    return mux.command(source, instant, instant + source.timeout)


def passed(*commands):
    """Feed commands of (input, stamp [ms]) to a new mux; return it, and which of them passed."""
    mux, verdicts = Mux(), []
    for source, stamp in commands:
        mux, passes = command(mux, source, stamp * MS)
        verdicts.append(passes)
    return mux, verdicts


@pytest.mark.parametrize(
    ("topic", "expected"),
    [("/cmd", "/cmd"), ("input/a", "/m/input/a"), ("~a", "/m/a"), ("~/a", "/m/a")],
)
def test_names_of_topics(topic, expected):
    assert full_topic("/m", topic) == expected


def test_no_input_drives_at_first():
    assert Mux().active == IDLE and Mux().deadline is None
    assert Mux().expire(10**18) == (Mux(), None)


def test_the_higher_priority_takes_over_and_holds_until_its_timeout():
    for stamp, expected in ((10, False), (209, False), (210, True), (500, True)):
        mux, verdicts = passed((PLAN, 0), (TELEOP, 10), (PLAN, stamp))
        assert verdicts == [True, True, expected]
        assert mux.active == ("plan" if expected else "teleop")


def test_a_lower_priority_blocks_no_input():
    mux, verdicts = passed((PLAN, 0), (TELEOP, 0), (PLAN, 1), (TELEOP, 2))
    assert verdicts == [True, True, False, True]
    assert mux.active == "teleop"


def test_the_car_stops_when_the_last_live_input_expires():
    mux, _ = passed((TELEOP, 100), (PLAN, 150))
    assert mux.deadline == 450 * MS  # the plan's, though it does not drive
    assert mux.expire(450 * MS - 1) == (mux, None)
    for late in (0, 7 * MS):
        after, stop = mux.expire(450 * MS + late)
        assert stop == 450 * MS and after.active == IDLE and after.deadline is None


def test_a_late_command_does_not_shorten_the_hold_of_a_newer_one():
    mux, verdicts = passed((TELEOP, 100), (TELEOP, 50))
    assert verdicts == [True, True] and mux.deadline == 300 * MS
    assert passed((TELEOP, 100), (TELEOP, 50), (PLAN, 299))[1][-1] is False
    # A command without a valid stamp holds longer.
    mux, passes = Mux().command(TELEOP, 100 * MS, 350 * MS)
    assert passes and mux.deadline == 350 * MS


def test_after_a_stop_the_mux_is_as_new():
    mux, _ = passed((TELEOP, 0))
    mux, _ = mux.expire(200 * MS)
    mux, passes = command(mux, PLAN, 201 * MS)
    assert passes and mux.active == "plan" and mux.deadline == 501 * MS


def test_restart_lets_all_inputs_expire():
    mux, _ = passed((TELEOP, 5000), (PLAN, 5000))
    mux = mux.restart(100 * MS)
    assert mux.deadline == 100 * MS
    assert command(mux, PLAN, 100 * MS)[1] is True
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
        mux, passes = command(mux, source, now)
        blocked = source is PLAN and now < last.get(TELEOP, 0) + TELEOP.timeout
        assert passes is not blocked
        assert mux.active == ("teleop" if blocked else source.name)
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
        ("priority", MISSING, "~subscribers[1]/priority is not set; expected a number from -1e+09"),
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
        (None, "~ is None; expected only the keys subscribers, publisher"),
        ([], "~ is []; expected only the keys subscribers, publisher"),
        ({}, "~publisher is not set; expected a topic"),
        (dict(GOOD, subscribers=[]), "~subscribers is []; expected a list of inputs"),
        (dict(GOOD, subscribers={"a": 1}), "~subscribers is {'a': 1}; expected a list of inputs"),
        (dict(GOOD, subscribers=["a"]), "~subscribers[1]/ is 'a'; expected only the keys name,"),
        (dict(GOOD, publisher=7), "~publisher is 7; expected a topic"),
        (dict(GOOD, output="x"), "~output is 'x'; expected only the keys subscribers, publisher"),
    ],
)
def test_bad_configuration(raw, expected):
    with pytest.raises(UserError) as caught:
        parse_config(raw)
    assert expected in str(caught.value)


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
        except UserError as error:
            assert str(error)
