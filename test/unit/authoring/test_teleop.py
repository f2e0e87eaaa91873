"""Teleoperation: the keys that are held, the commands for them, and when they are sent."""

import pytest

from mushr_ros_intro.authoring import teleop
from mushr_ros_intro.authoring.teleop import BOUNCE, STOP, Keys, Schedule, keys_in
from mushr_ros_intro.stamps import COMMAND_PERIOD

MS = 1_000_000
"""[ns]"""


def down(keys):
    """Return the state after `keys` went down, in this order."""
    state = Keys()
    for key in keys:
        state = state.down(key)
    return state


def typed(*characters):
    """Return the state after characters (key, instant [ms])."""
    state = Keys()
    for key, now in characters:
        state = state.typed(key, now * MS)
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
        (["Up", "Left"], (2.0, 0.34)),
        (["Down", "Right"], (-2.0, -0.34)),
        (["Up", "w"], (2.0, 0.0)),
    ],
)
def test_keys_become_a_command(keys, wanted):
    assert down(keys).drive(2.0, 0.34) == wanted


@pytest.mark.parametrize("key", ["space", "Escape", "q", "Shift_L", "F4", "\x1bOS", "\x1bs"])
def test_any_other_key_releases_all(key):
    assert down("wa").down(key) == Keys()
    assert down("wa").typed(key, 0) == Keys()


def test_repeats_of_a_held_key_are_one_long_press():
    """X11 reports up and down at the same instant, about thirty times a second."""
    keys = down("w")
    for now in range(0, 2000 * MS, 33 * MS):
        keys = keys.up("w", now)
        assert keys.at(now + BOUNCE - 1).held
        keys = keys.down("w").at(now + 33 * MS)
        assert keys.drive(1.0, 0.0) == (1.0, 0.0)


def test_a_key_that_goes_up_is_released():
    keys = down("wa").up("a", 5 * MS)
    assert keys.at(24 * MS).drive(2.0, 0.34) == (2.0, 0.34)
    assert keys.at(25 * MS).drive(2.0, 0.34) == (2.0, 0.0)
    assert keys.up("W", 6 * MS).at(6 * MS + BOUNCE) == Keys()


FIRST, NEXT = teleop.FIRST_HOLD // MS, teleop.NEXT_HOLD // MS


@pytest.mark.parametrize(
    "characters, end, wanted",
    [
        ([("w", 0)], FIRST, (2.0, 0.0)),
        ([("W", 0)], FIRST, (2.0, 0.0)),
        ([("w", 0), ("w", FIRST - 1)], FIRST - 1 + NEXT, (2.0, 0.0)),
        ([("w", 0), ("w", 660)], 660 + NEXT, (2.0, 0.0)),  # X.org's delay
        ([("w", 0), ("w", FIRST)], 2 * FIRST, (2.0, 0.0)),  # it was released in between
        ([("w", 0), ("s", 1)], FIRST + 1, (-2.0, 0.0)),  # the opposite key
        ([("a", 0), ("d", 1)], FIRST + 1, (0.0, -0.34)),
        # A second key keeps the first, which the terminal no longer repeats ...
        ([("w", 0), ("w", 500), ("a", 600), ("a", 1100)], 1100 + NEXT, (2.0, 0.34)),
        # ... and does not shorten it.
        ([("w", 0), ("a", 100), ("a", 133)], 100 + FIRST, (2.0, 0.0)),
    ],
)
def test_characters_hold_their_keys(characters, end, wanted):
    keys = typed(*characters)
    assert keys.at(end * MS - 1).drive(2.0, 0.34) == wanted
    assert keys.at(end * MS) == Keys()


@pytest.mark.parametrize(
    "typed, keys, rest",
    [
        ("wA\x00\xe9", ["w", "A", "\x00", "\xe9"], ""),
        ("\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"], ""),
        ("\x1bOAw\x1bOD", ["up", "w", "left"], ""),  # in the application mode of the keys
        ("\x1bOS", ["\x1bOS"], ""),  # F4
        ("\x1b[[A", ["\x1b[[A"], ""),  # F1 in the Linux console
        ("\x1b[15~d", ["\x1b[15~", "d"], ""),  # F5
        ("\x1b[1;5A\x1bO5A", ["\x1b[1;5A", "\x1bO5A"], ""),  # Ctrl and an arrow
        ("\x1b\x1b[A", ["\x1b\x1b[A"], ""),  # Alt and an arrow
        ("\x1bs\x1bw", ["\x1bs", "\x1bw"], ""),  # Alt and a letter
        *((begin, [], begin) for begin in ("\x1b", "\x1b[", "\x1bO", "\x1b[1;", "\x1b[[")),
        ("w\x1b", ["w"], "\x1b"),
    ],
)
def test_keys_of_a_terminal(typed, keys, rest):
    assert keys_in(typed) == (keys, rest)


def sent(*wants):
    """Return what a schedule sends for (instant [ns], wanted command) in turn."""
    schedule, messages = Schedule(), []
    for now, wanted in wants:
        schedule, message = schedule.step(wanted, now)
        if message is not None:
            messages.append((now, message))
    return messages


def test_a_held_key_sends_ten_times_a_second():
    """A poll every 7 ms, which does not divide the period, loses no command in 10 s."""
    messages = sent(*((now, (2.0, 0.0)) for now in range(0, 100 * COMMAND_PERIOD, 7 * MS)))
    assert len(messages) == 100
    for number, (now, message) in enumerate(messages):
        assert message == (2.0, 0.0)
        assert number * COMMAND_PERIOD <= now < number * COMMAND_PERIOD + 7 * MS


def test_a_change_is_sent_at_once_and_the_stop_once():
    w, wa, ws = (2.0, 0.0), (2.0, 0.34), STOP
    wants = [(0, w), (5, wa), (9, None), (10, None), (10**10, None), (10**10, ws)]
    assert sent(*wants) == [(0, w), (5, wa), (9, STOP), (10**10, ws)]


@pytest.mark.parametrize("now", [50 * COMMAND_PERIOD, -50 * COMMAND_PERIOD])
def test_after_a_pause_or_a_jump_of_the_clock_there_is_one_command(now):
    wants = [(each, (1.0, 0.0)) for each in (0, now, now + 1)]
    assert sent(*wants) == wants[:2]
