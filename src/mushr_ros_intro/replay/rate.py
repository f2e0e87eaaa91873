"""Judge the rate of the commands of a replay, by their stamps or their arrival."""

from typing import List, Optional, Sequence, Tuple

from mushr_ros_intro.replay.recording import MAX_SHIFT, Recorded, Run, Sent, matched, runs_of
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS, STAMP_TOLERANCE
from mushr_ros_intro.wording import counted

_YEAR = 3e7
"""A stamp that is later by more than this is wall-clock time [s]. A replay begins in 2001."""

_JITTER = COMMAND_PERIOD // 2
"""Allowed deviation of the time between two commands [ns]."""

_LEAD_TOLERANCE = 5 * COMMAND_PERIOD // 2
"""Allowed difference between two commands in the time from the arrival to the stamp [ns]."""

_SPAN_TOLERANCE = 2 * COMMAND_PERIOD
"""Allowed deviation of the time from a row's first to its last command from its duration, and of
the last command of a row from the time at which the plan has it [ns]."""


def judge_rate(recorded: Recorded) -> Tuple[Optional[bool], str]:
    """Judge whether each row has its number of commands, evenly spaced, by stamp or arrival."""
    runs, count, surplus, end = runs_of(recorded.plan), 0, 0, None
    commands: List[Sent] = []
    span = planned = 0
    for run, group in matched(recorded):
        # If the last row of the plan is a stop, the final stop belongs to the same group.
        if run == runs[-1] and run.speed == 0.0 and len(group) > run.expected:
            group.pop()
        commands += group
        surplus += len(group) - run.expected
        planned += run.duration
        fault = _stamp_fault(group) or _rate_fault(run, group, surplus)
        if not fault and end is not None and group[0].time - end > _LEAD_TOLERANCE:
            seconds = (group[0].time - end) / NANOSECONDS
            fault = f"its first command comes {seconds:.3g} s after the last one of {runs[count-1]}"
        span = group[-1].time - recorded.begin
        late = span - (planned - run.duration + (len(group) - 1) * COMMAND_PERIOD)
        if not fault and abs(late) > _SPAN_TOLERANCE and span:
            when = f"{abs(late) / NANOSECONDS:.3g} s {'late' if late > 0 else 'early'}"
            period = span / (len(commands) - 1) / NANOSECONDS
            fault = (
                f"its last command comes {when}: the commands come every "
                f"{period:.4g} s; expected every 0.1 s, so that the times add "
                "up to those of the plan"
            )
        if fault:
            return False, f"{run}: {fault}"
        end = group[-1].time
        count += 1
    if count < len(runs):
        return None, f"not judged: the commands of {runs[count]} did not arrive in the plan's order"
    fault = _lead_fault(commands)
    pace = f"{(len(commands) - 1) * NANOSECONDS / span:.3g} commands per second; " if span else ""
    limit = _SPAN_TOLERANCE / NANOSECONDS
    return not fault, fault or f"{pace}each row is as long as in the plan, tolerance {limit:g} s"


def _stamp_fault(group: Sequence[Sent]) -> str:
    """Return what is wrong with a stamp that is set, but not valid; "" if all are right."""
    for number, sent in enumerate(group, 1):
        away = (sent.stamp - sent.arrived) / NANOSECONDS
        if sent.stamp and not sent.has_stamp:
            if away > _YEAR:
                return (
                    f"the stamp of message {number} is wall-clock time, such as time.time(); "
                    "expected the time of ROS, such as rospy.Time.now()"
                )
            limit = STAMP_TOLERANCE / NANOSECONDS
            return (
                f"the stamp of message {number} differs by {away:+.6g} s from the time of its "
                f"arrival; expected at most {limit:g} s"
            )
    return ""


def _lead_fault(commands: Sequence[Sent]) -> str:
    """Return which command arrives in advance, and not when it is due; "" if none does."""
    leads = [sent.time - sent.arrived for sent in commands]
    if max(leads) - min(leads) > _LEAD_TOLERANCE:
        number = leads.index(max(leads)) + 1
        return (
            f"message {number} arrives {max(leads) / NANOSECONDS:.3g} s before its stamp, another "
            f"one {min(leads) / NANOSECONDS:.3g} s; expected ten commands per second, not many at "
            "the same time"
        )
    return ""


def _rate_fault(run: Run, group: Sequence[Sent], surplus: int) -> str:
    """Return what is wrong with the number or the times of a run's commands, if anything.

    Args:
        run: the rows.
        group: their commands.
        surplus: the number of commands, of these rows and those before, that are too many.
    """
    times = [sent.time for sent in group]
    seconds, span = run.duration / NANOSECONDS, (times[-1] - times[0]) / NANOSECONDS
    if abs(surplus) > MAX_SHIFT:
        count = len(group)
        lasted = f" in {span * count / (count - 1):.3g} s" if span else ""
        received = f"{counted(count, 'command')} received{lasted}"
        return f"{received}; expected {run.expected} in {seconds:g} s"
    if fault := _step_fault(times):
        return fault
    if abs(times[-1] - times[0] - run.duration) > _SPAN_TOLERANCE:
        if not span and group[0].has_stamp:
            return f"its {len(group)} commands have the same stamp; expected the time of each one"
        expected = f"{seconds:g} s, tolerance {_SPAN_TOLERANCE / NANOSECONDS:g} s"
        return f"its {len(group)} commands span {span:.3g} s; expected {expected}"
    return ""


def _step_fault(times: Sequence[int]) -> str:
    """Return the first gap or backward step in the times of a run [ns]; "" if there is none."""
    for number, (earlier, later) in enumerate(zip(times, times[1:]), 2):
        step = (later - earlier) / NANOSECONDS
        if step < 0.0:
            return (
                f"message {number} is stamped {-step:.6g} s before message {number - 1}; "
                "expected rising stamps"
            )
        if later - earlier > COMMAND_PERIOD + _JITTER:
            return (
                f"{step:.6g} s between messages {number - 1} and {number}; "
                f"expected {COMMAND_PERIOD / NANOSECONDS:g} s"
            )
    return ""
