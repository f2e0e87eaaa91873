"""Judge a drive: what its node, its plan and the reports of the car say about its end."""

from bisect import bisect_left
from typing import List, NamedTuple, Optional

from mushr_ros_intro.geometry import Pose, compose, inverse
from mushr_ros_intro.monitor.drive import PlannedDrive, Report
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS, SETTLING, STAMP_TOLERANCE

POSE_TOLERANCE = 1e-3
"""A final pose that differs by less is the expected one; the car need not be watched longer."""

TOLERANCE = 0.1
"""A start pose or a final pose that differs by more is an error [m, rad]."""


class Verdict(NamedTuple):
    """The end of a drive."""

    is_good: bool
    """Whether the plan has been driven, as far as the monitor can see."""
    lines: List[str]


def settled(planned: PlannedDrive) -> Optional[Report]:
    """Return a report of the car at rest after the plan, None if there is none yet.

    A late command is inserted into the car's history, and can still change the pose.
    """
    for report in planned.drive.reports:
        is_close = report.pose.is_close_to(planned.expected.pose, POSE_TOLERANCE)
        if report.stamp >= planned.rest + SETTLING + (0 if is_close else STAMP_TOLERANCE):
            return report
    return None


def start_fault(planned: PlannedDrive) -> str:
    """Return a message if the car was not at the start pose when the plan began, or an empty one.

    ROS does not order two topics: the start pose may come just before the first command, and after
    the report before it; or a little late. A command without a stamp gets the time of its arrival
    here, when the car may have moved.
    """
    drive, start = planned.drive, planned.plan.start
    if _is_start_pose(planned):
        return ""
    reports = [*reversed(drive.before), *filter(None, [drive.since])]
    states = planned.expected.states
    stamps = [state.stamp for state in states]
    for report in reports:
        index = bisect_left(stamps, report.stamp - planned.begin)
        predicted = states[min(index, len(stamps) - 1)].pose
        if any(report.pose.is_close_to(each, TOLERANCE) for each in (start, predicted)):
            return ""
    if not reports:
        return ""
    text = f"the car was not at the start pose {start} when the first command came: it was at "
    text += str(reports[0].pose)
    if drive.placed and drive.placed.pose.is_close_to(start, TOLERANCE):
        late = (drive.placed.stamp - drive.first) / NANOSECONDS
        text += f", and was placed at the start pose {late:.2f} s later"
    return text


def _is_start_pose(planned: PlannedDrive) -> bool:
    """Return whether the node of the drive placed the car, about when its first command came."""
    placed = planned.drive.placed
    if not placed or placed.stamp > planned.drive.first + 2 * COMMAND_PERIOD:
        return False
    return placed.pose.is_close_to(planned.plan.start, TOLERANCE)


def verdict(
    name: str, planned: PlannedDrive, report: Optional[Report], is_reported: bool
) -> Verdict:
    """Judge a drive that has ended.

    Args:
        name: of the node that sent the commands.
        planned: the drive, beside its plan.
        report: a report of the car at rest, None if there is none.
        is_reported: whether the car has reported its pose during the drive.
    """
    expected = planned.expected
    if fault := _fault(name, planned, report, is_reported):
        return Verdict(False, [fault])
    if not expected.is_placed:
        move = _move(planned.plan.start, expected.pose)
        return Verdict(True, [f"all commands have been sent; {move}"])
    if not report:
        text = f"all commands have been sent; the car should end at {expected.pose}. No node "
        return Verdict(True, [f"{text}reports the car's pose, so it is not known where the car is"])
    distance = report.pose.distance_to(expected.pose)
    angle = report.pose.angle_to(expected.pose)
    is_close = report.pose.is_close_to(expected.pose, TOLERANCE)
    done = "the plan has been driven" if is_close else "all commands of the plan have been sent"
    # The distances between the reported poses have a larger sum if a command arrived late.
    driven = ""
    if expected.distance is not None and report.pose.is_close_to(expected.pose, POSE_TOLERANCE):
        driven = f"drove {expected.distance:.2f} m and "
    return Verdict(
        True,
        [
            f"{done}; the car should end at {expected.pose}",
            f"the car {driven}stopped at {report.pose}; difference {distance:.1e} m, "
            f"{angle:.1e} rad",
        ],
    )


def _fault(name: str, planned: PlannedDrive, report: Optional[Report], is_reported: bool) -> str:
    """Return the reason why the plan has not been driven, or an empty text; see `verdict`."""
    drive, expected = planned.drive, planned.expected
    cause = _cause(planned)
    start = start_fault(planned) if expected.is_placed else ""
    wall = ""
    if drive.wall:
        where = planned.position(drive.wall.stamp)
        wall = f"the car stopped at a wall in {where} at {drive.wall.pose}"
    if not planned.is_complete:
        where = planned.position(drive.newest)
        last = drive.reports[-1].pose if drive.reports else None
        how = "stopped at" if drive.stands else "was last reported at"
        stopped = f"; the car {how} {last}" if last else ""
        ended = f"the drive of {name} ended in {where}{stopped}"
        return "; ".join(filter(None, (ended, wall, start)))
    if expected.is_placed and is_reported and not report:
        where = drive.lost or "the end of the plan"
        return (
            f"the car has not reported its pose since {where}, so it is not known where it is. "
            "If it has ended, start it again"
        )
    if wall:
        return "; ".join(filter(None, (wall, start, cause if drive.others else "")))
    if not report or not expected.is_placed:
        return ""
    # Only an exact final pose proves that the start was right.
    if report.pose.is_close_to(expected.pose, POSE_TOLERANCE if start else TOLERANCE):
        return ""
    if start:
        return f"{start}. It stopped at {report.pose}"
    if not expected.is_exact:
        return ""
    distance = report.pose.distance_to(expected.pose)
    return (
        f"after the plan, the car was at {report.pose}, but it should have ended at "
        f"{expected.pose}, {distance:.2f} m and {report.pose.angle_to(expected.pose):.2f} rad from "
        f"there. {cause}"
    )


def _cause(planned: PlannedDrive) -> str:
    """Return the likely cause of a wrong final pose."""
    drive = planned.drive
    if drive.others:
        return f"{', '.join(sorted(drive.others))} also published commands"
    if drive.lost:
        return f"In {drive.lost}, the car did not report its pose, or it was restarted"
    placed = drive.placed
    if placed and not _is_start_pose(planned):
        where = planned.position(placed.stamp)
        return f"In {where}, the car was placed at another pose: it was at {placed.pose}"
    if difference := planned.difference():
        return f"The commands for the car differ from the plan: {difference}"
    if placed:
        return "The start pose came after the first command"
    return "The commands for the car were those of the plan. Did another node place it?"


def _move(start: Pose, end: Pose) -> str:
    """Return the predicted final pose, relative to the start."""
    move = compose(inverse(start), end)
    x, y, theta = (round(value, 2) + 0.0 for value in move)  # no negative zero
    return (
        f"the car should stand {abs(x):.2f} m {'ahead of' if x >= 0.0 else 'behind'} its start, "
        f"{abs(y):.2f} m to the {'left' if y >= 0.0 else 'right'}, and turned by {theta:.2f} rad"
    )
