"""Test which configurations a mux accepts, and the messages for those that it refuses."""

import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.sim.mux_config import Config, ConfigError, Input, parse_config

MS = 1_000_000
"""[ns]"""

TELEOP = Input("teleop", "input/teleop", 200 * MS, 5, "keys")
PLAN = Input("plan", "input/plan", 300 * MS, 1, "")

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
        ("name", MISSING, "subscribers[1] lacks the key 'name'; expected a name"),
        ("name", "", "subscribers[1] has '' for the key 'name'; expected a name"),
        ("name", 3, "subscribers[1] has 3 for the key 'name'; expected a name"),
        ("name", "idle", "subscribers[1] has the name 'idle', which means that no input drives"),
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
        ("timeout", NAN, "subscribers[1] has nan for the key 'timeout'; expected a number"),
        ("timeout", INF, "subscribers[1] has inf for the key 'timeout'; expected a number"),
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
    assert expected in str(caught.value) and "; expected" in str(caught.value)


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
