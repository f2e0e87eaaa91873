"""Test which commands pass the mux."""

from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.sim.mux import IDLE, Input, Mux

MS = 1_000_000
"""[ns]"""

TELEOP = Input("teleop", "input/teleop", 200 * MS, 5)
PLAN = Input("plan", "input/plan", 300 * MS, 1)


def passed(*commands):
    """Feed commands of (input, stamp [ms]) to a new mux; return it, and which of them passed."""
    mux, verdicts = Mux(), []
    for source, stamp in commands:
        mux, passes = mux.command(source, stamp * MS)
        verdicts.append(passes)
    return mux, verdicts


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
    # One of unknown age holds longer.
    mux, passes = Mux().command(TELEOP, 100 * MS, slack=50 * MS)
    assert passes and mux.deadline == 350 * MS


def test_after_a_stop_the_mux_is_as_new():
    mux, _ = passed((TELEOP, 0))
    mux, _ = mux.expire(200 * MS)
    mux, passes = mux.command(PLAN, 201 * MS)
    assert passes and mux.active == "plan" and mux.deadline == 501 * MS


def test_restart_lets_all_inputs_expire():
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
