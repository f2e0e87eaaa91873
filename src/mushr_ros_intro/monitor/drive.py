"""One drive as a monitor sees it: the commands for the car, and the poses that the car reports.

All instants are stamps [ns]. A command moves the car if its speed or its steering angle is not 0;
a drive begins with the first such command.
"""

import itertools
from bisect import bisect_right
from collections import deque
from typing import Deque, Iterable, List, NamedTuple, Optional, Sequence, Set

from mushr_ros_intro.car.model import Command, State
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Plan, shortest_decimal
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

JUMP = 0.1
"""If the pose changes by this distance more than the car can drive, the car was placed [m]."""

KEPT = 2000
"""Number of reports that are kept, of a car, and of a drive after its newest command."""


class Report(NamedTuple):
    """A pose that the car has reported."""

    stamp: int
    pose: Pose
    """base_footprint in the map frame."""


class Run(NamedTuple):
    """Consecutive commands, or rows of a plan, with the same speed and steering angle."""

    speed: float
    steering_angle: float
    begin: int
    """A stamp; of rows, the time from the begin of the plan [ns]."""
    end: int = 0
    """The same, of rows."""
    lines: str = ""
    """Of rows, for messages, such as lines 2 to 12."""

    @property
    def moves(self) -> bool:
        """Return whether these commands move the car."""
        return bool(self.speed or self.steering_angle)


def sections_of(plan: Plan) -> List[Run]:
    """Return the rows of a plan as runs."""
    sections, begin = [], 0
    for (speed, angle), group in itertools.groupby(plan.rows, key=lambda row: row[:2]):
        rows = list(group)
        end = begin + sum(row.duration for row in rows)
        first, last = rows[0].line, rows[-1].line
        lines = f"line {first}" if first == last else f"lines {first} to {last}"
        sections.append(Run(speed, angle, begin, end, lines))
        begin = end
    return sections


class Expectation(NamedTuple):
    """What is expected of a drive."""

    plan: Plan
    """With its speeds limited to that of the node."""
    states: Sequence[State]
    """The predicted states, in the map frame if the car is placed at the start pose."""
    distance: Optional[float]
    """The driven distance, forward and in reverse [m]; None if noise or a wall changes it."""
    is_placed: bool
    """Whether the node places the car at the start pose."""
    is_exact: bool
    """Whether the parameters of the car are known, and it has no noise."""

    @property
    def pose(self) -> Pose:
        """The predicted final pose."""
        return self.states[-1].pose


class Drive:
    """The commands of a drive since the first one, the reports, and what else was observed."""

    def __init__(self, first: Command, before: Iterable[Report]) -> None:
        """Begin with the first command that moves the car, and the last reports before it."""
        self.first = first.stamp
        self.runs: List[Run] = []
        self.newest = first.stamp
        """The stamp of the newest command that moves the car."""
        self.stop: Optional[int] = None
        """The stamp of the first stop after it, None if there is none."""
        self.before = [*before]
        """The last reports that are not newer than the first command."""
        self.since: Optional[Report] = None
        """The first report that is newer than the first command."""
        self.reports: Deque[Report] = deque(maxlen=KEPT)
        """The reports since the newest command that moves the car."""
        self.placed: Optional[Report] = None
        """The first report after another node has placed the car."""
        self.wall: Optional[Report] = None
        """The last contact with a wall."""
        self.lost = ""
        """Where the car was lost or restarted."""
        self.others: Set[str] = set()
        """Other nodes, and inputs of the mux, whose commands the car got or may have got."""
        self._last: Optional[Report] = None
        """The newest report that is newer than the first command."""
        self._fastest = 0.0
        self.add(first)

    def add(self, command: Command) -> None:
        """Add the next command."""
        run = Run(command.speed, command.steering_angle, command.stamp)
        if not self.runs or self.runs[-1][:2] != run[:2]:
            self.runs.append(run)
            self._fastest = max(self._fastest, abs(run.speed))
        if run.moves:
            self.newest = max(self.newest, run.begin)
            self.stop = None
            self.reports.clear()
        elif self.stop is None:
            self.stop = run.begin

    def report(self, report: Report) -> None:
        """Add a report of the car."""
        if report.stamp <= self.first:
            self.before.append(report)
            return
        self.since = self.since or report
        before = self._last or (self.before[-1] if self.before else None)
        self._last = report
        if before and not self.placed:
            seconds = (report.stamp - before.stamp) / NANOSECONDS
            if report.pose.distance_to(before.pose) > self._fastest * max(seconds, 0.0) + JUMP:
                self.placed = report
        self.reports.append(report)

    @property
    def stands(self) -> bool:
        """Return whether the car has reported one pose twice since the newest command."""
        poses = [report.pose for report in list(self.reports)[-2:]]
        return len(poses) == 2 and poses[0] == poses[1]


class PlannedDrive:
    """A drive beside its plan, and what is expected of it."""

    def __init__(self, expected: Expectation, drive: Drive) -> None:
        self.expected = expected
        self.plan = plan = expected.plan
        self.drive = drive
        self._ends = list(itertools.accumulate(row.duration for row in plan.rows))
        sections = sections_of(plan)
        is_late = not sections[0].moves
        self._sections = sections[is_late:]
        self.begin = drive.first - (sections[0].end if is_late else 0)
        """When the plan begins; it may begin with a row in which the car stands."""
        stops = [each for each in sections if not each.moves]
        self.longest_stop = max((each.end - each.begin for each in stops), default=0)
        """The longest time for which the car stands within the plan."""
        is_stop = bool(stops) and stops[-1] is sections[-1]
        self._moving_end = sections[-1].begin if is_stop else plan.duration

    def time(self, instant: int) -> int:
        """Return how much of the plan has been driven at an instant [ns].

        A row may last longer in the drive than in the plan; then the next row begins later.
        """
        elapsed = instant - self.begin
        begins = [run.begin for run in self.drive.runs]
        index = max(bisect_right(begins, instant) - 1, 0)
        run = self.drive.runs[index]
        if index < len(self._sections) and self._sections[index][:2] == run[:2]:
            section = self._sections[index]
            elapsed = min(section.begin + max(instant - run.begin, 0), section.end - 1)
        return min(max(elapsed, 0), self.plan.duration)

    def position(self, instant: int) -> str:
        """Return the line of the plan's file at an instant, such as "line 4 of 23"."""
        rows = self.plan.rows
        index = min(bisect_right(self._ends, self.time(instant)), len(rows) - 1)
        return f"line {rows[index].line} of {rows[-1].line}"

    @property
    def end(self) -> int:
        """When the plan ends; if rows last longer in the drive than in the plan, the stop."""
        return max(self.drive.stop or 0, self.begin + self.plan.duration)

    @property
    def braking(self) -> int:
        """The predicted time from the end of the plan until the car is at rest [ns]."""
        return self.expected.states[-1].stamp - self.plan.duration

    @property
    def rest(self) -> int:
        """When the car should be at rest."""
        return self.end + self.braking

    @property
    def reaches_end(self) -> bool:
        """Return whether the commands reach the end of the plan.

        A drive with the rows of the plan, but slower ones, also has to drive the last of them.
        """
        runs = self.drive.runs
        is_same = all(part[:2] == run[:2] for part, run in zip(self._sections, runs))
        left = self._sections[len(runs) :]
        if is_same and any(each.moves for each in left):
            return False
        return self.drive.newest + 2 * COMMAND_PERIOD >= self.begin + self._moving_end

    @property
    def is_complete(self) -> bool:
        """Return whether the commands reach the end of the plan, and then stop."""
        return self.drive.stop is not None and self.reaches_end

    def difference(self) -> str:
        """Return how the commands of a complete drive differ from the plan, or an empty text."""
        runs = self.drive.runs
        following = [*runs[1:], Run(0.0, 0.0, self.drive.stop or self.drive.newest)]
        for section, run, then in itertools.zip_longest(self._sections, runs, following):
            if run is None:
                break
            if section is None:
                return f"{shown(run)} came after the end of the plan" if run.moves else ""
            if section[:2] != run[:2]:
                asked = f"the plan asks for {shown(section)} in {section.lines}"
                return f"{asked}, but {shown(run)} came"
            if run is runs[-1] and not run.moves:
                break  # the stop at the end of the plan
            lasted, planned = then.begin - run.begin, section.end - section.begin
            if abs(lasted - planned) > COMMAND_PERIOD // 2:
                text = f"the command of {section.lines} lasted {lasted / NANOSECONDS:.2f} s; the "
                text += f"plan asks for {planned / NANOSECONDS:g} s"
                if lasted < planned and not then.moves:
                    text += ". Then a stop came, as from the mux if no command comes for 0.2 s"
                return text
        return ""


def shown(command: Run) -> str:
    """Return a speed and a steering angle for messages."""
    speed, angle = map(shortest_decimal, command[:2])
    return f"{speed:g} m/s, {angle:g} rad"
