"""Teleoperation: which keys are held, what they ask for, and when it is sent."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.authoring.teleop import (
    BOUNCE,
    DIRECTIONS,
    FIRST_HOLD,
    NEXT_HOLD,
    PERIOD,
    STOP,
    Keys,
    Schedule,
)

MS = 1_000_000
"""[ns]"""


def down(keys):
    """Return the state with `keys`, in this order, down."""
    state = Keys()
    for key in keys:
        state = state.down(key)
    return state


@pytest.mark.parametrize(
    "keys, wanted",
    [
        ("", None),
        ("w", (2.0, 0.0)),
        ("s", (-2.0, 0.0)),
        ("a", (0.0, 0.34)),
        ("d", (0.0, -0.34)),
        ("wa", (2.0, 0.34)),
        ("dw", (2.0, -0.34)),
        ("sd", (-2.0, -0.34)),
        ("ws", (0.0, 0.0)),
        ("wad", (2.0, 0.0)),
        ("WA", (2.0, 0.34)),
        ("ww", (2.0, 0.0)),
    ],
)
def test_what_keys_ask_for(keys, wanted):
    assert down(keys).drive(2.0, 0.34) == wanted


@pytest.mark.parametrize("key", ["space", "Escape", "q", "Shift_L"])
def test_any_other_key_lets_go(key):
    assert down("wa").down(key) == Keys()
    assert down("wa").typed(key, 0) == Keys()


def test_repeats_of_a_held_key_are_one_long_press():
    """X11 says up and down, at the same instant, some thirty times a second."""
    keys = down("w")
    for now in range(0, 2000 * MS, 33 * MS):
        keys = keys.up("w", now)
        assert keys.at(now + BOUNCE - 1).held
        keys = keys.down("w").at(now + 33 * MS)
        assert keys.drive(1.0, 0.0) == (1.0, 0.0)


def test_a_key_that_comes_up_is_let_go():
    keys = down("wa").up("a", 5 * MS)
    assert keys.at(5 * MS + BOUNCE).drive(2.0, 0.34) == (2.0, 0.0)
    assert keys.up("W", 6 * MS).at(6 * MS + BOUNCE) == Keys()


@pytest.mark.parametrize("key", ["w", "W"])
def test_a_character_holds_its_key_for_a_while(key):
    keys = Keys().typed(key, 0)
    assert keys.at(FIRST_HOLD - 1).drive(2.0, 0.34) == (2.0, 0.0)
    assert keys.at(FIRST_HOLD) == Keys()


def test_repeated_characters_hold_on_and_end_soon():
    """0.5 s until the repeats begin, then one every 33 ms."""
    keys = Keys().typed("w", 0)
    for now in range(500 * MS, 3000 * MS, 33 * MS):
        assert keys.at(now).held
        keys = keys.typed("w", now)
    assert keys.at(now + NEXT_HOLD) == Keys()


def test_a_character_that_comes_again_after_its_key_was_let_go_holds_as_the_first():
    keys = Keys().typed("w", 0).typed("w", FIRST_HOLD)
    assert keys.at(2 * FIRST_HOLD - 1).held
    assert keys.at(2 * FIRST_HOLD) == Keys()


def test_in_a_terminal_a_second_key_keeps_the_first():
    keys = Keys().typed("w", 0).typed("w", 500 * MS).typed("a", 600 * MS)
    for now in range(1100 * MS, 2000 * MS, 33 * MS):
        assert keys.at(now).drive(2.0, 0.34) == (2.0, 0.34)
        keys = keys.typed("a", now)
    assert keys.at(now + NEXT_HOLD) == Keys()


def test_in_a_terminal_repeats_of_a_key_do_not_cut_short_another_one():
    keys = Keys().typed("w", 0).typed("a", 100 * MS).typed("a", 133 * MS)
    assert keys.at(133 * MS + NEXT_HOLD).drive(2.0, 0.34) == (2.0, 0.0)


def test_in_a_terminal_the_opposite_key_takes_over():
    assert Keys().typed("w", 0).typed("s", MS).drive(2.0, 0.34) == (-2.0, 0.0)
    assert Keys().typed("a", 0).typed("d", MS).drive(2.0, 0.34) == (0.0, -0.34)


@given(st.lists(st.tuples(st.sampled_from("wasdWq "), st.integers(0, 10**9)), max_size=30))
def test_whatever_is_typed_ends(typed):
    keys, now = Keys(), 0
    for key, later in typed:
        now += later
        keys = keys.typed(key, now)
        assert len({each.key for each in keys.held}) == len(keys.held) <= len(DIRECTIONS)
    assert keys.at(now + FIRST_HOLD) == Keys()


def sent(schedule, wants):
    """Return what is sent, given (instant, what is wanted) in turn."""
    messages = []
    for now, wanted in wants:
        schedule, message = schedule.step(wanted, now)
        if message is not None:
            messages.append((now, message))
    return messages


def test_a_held_key_sends_ten_times_a_second():
    """Looked at every 7 ms, which is no divisor of the period, it loses nothing over 10 s."""
    messages = sent(Schedule(), [(now, (2.0, 0.0)) for now in range(0, 100 * PERIOD, 7 * MS)])
    assert len(messages) == 100
    for number, (now, message) in enumerate(messages):
        assert message == (2.0, 0.0)
        assert number * PERIOD <= now < number * PERIOD + 7 * MS


def test_a_change_goes_out_at_once_and_the_stop_once():
    wants = [(0, (2.0, 0.0)), (5, (2.0, 0.34)), (9, None), (10, None), (10**10, None)]
    wants.append((10**10, STOP))  # W and S together: wanted, and held
    assert sent(Schedule(), wants) == [
        (0, (2.0, 0.0)),
        (5, (2.0, 0.34)),
        (9, STOP),
        (10**10, STOP),
    ]


def test_nothing_is_made_up_for_after_a_pause():
    """A machine that stood still, or a clock that was set, gives one message and a new start."""
    for now in (50 * PERIOD, -50 * PERIOD):
        wants = [(0, (1.0, 0.0)), (now, (1.0, 0.0)), (now + 1, (1.0, 0.0))]
        assert [instant for instant, _ in sent(Schedule(), wants)] == [0, now]
