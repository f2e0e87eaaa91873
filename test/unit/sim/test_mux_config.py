"""Test which configurations a mux accepts, and the messages for those that it refuses."""

import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.sim.mux import Config, Input, parse_config

MS = 1_000_000
"""[ns]"""

TELEOP = Input("teleop", "input/teleop", 200 * MS, 5)
PLAN = Input("plan", "input/plan", 300 * MS, 1)

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
