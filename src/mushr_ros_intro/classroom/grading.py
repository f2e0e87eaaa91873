"""Grade a class: replay each plan with each submission, unless its drive is stored; judge all."""

import multiprocessing
import os
import signal
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from typing import Any, Dict, Generator, Iterator, List, Mapping, Sequence, Tuple
from xml.etree import ElementTree

from mushr_ros_intro.classroom.grader import build, judge_and_draw, probe
from mushr_ros_intro.classroom.grades import Grade, PlanGrade, StoredDrive
from mushr_ros_intro.classroom.store import Store, hash_of, hash_of_folder
from mushr_ros_intro.classroom.submissions import Submission
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.replay.job import Job, Setting, record
from mushr_ros_intro.replay.own_process import prepared_processes
from mushr_ros_intro.replay.reference import Exercise
from mushr_ros_intro.replay.setting import parameter_words

MAX_SOURCE = 100_000
"""Size of the stored part of a node's source [bytes]."""

_TEXTS = ("outcome", "output", "error")
"""The texts of a recording that may contain paths of this machine."""


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def judges() -> ProcessPoolExecutor:
    """Return processes that judge and draw drives.

    matplotlib is slow and not thread-safe. Ctrl-C is for this process only.
    """
    cores = len(os.sched_getaffinity(0))
    return ProcessPoolExecutor(cores, prepared_processes(), _ignore_interrupts)


def judged(
    grades: Sequence[Grade], tolerances: Mapping[str, float], pool: ProcessPoolExecutor
) -> List[Grade]:
    """Return stored results with the verdicts on their drives."""
    futures = [
        [
            (drive.plan, pool.submit(judge_and_draw, drive.recorded, tolerances))
            for drive in grade.drives
            if drive.recorded and not (grade.fault or grade.error)
        ]
        for grade in grades
    ]
    return [
        grade._replace(plans=tuple(PlanGrade(plan, *future.result()) for plan, future in each))
        for grade, each in zip(grades, futures)
    ]


class Task:
    """A submission, the plans that it drives, and what is known of its drives."""

    def __init__(self, submission: Submission, plans: Dict[str, Exercise]) -> None:
        """Begin without drives; `plans` are by name."""
        self.submission, self.plans = submission, plans
        self.old = not_graded(submission)
        """The stored result of an earlier run."""
        self.drives: Dict[str, StoredDrive] = {}
        """By plan, in the order of the command line."""
        self.error = ""

    @property
    def missing(self) -> List[str]:
        """The plans that must be driven."""
        return [each.plan for each in self.drives.values() if not (each.fault or each.recorded)]


_KILL_PERIOD = 0.05
"""Between two looks for replays that are still running after an interruption [s]."""


class Grading:
    """The grading of a class with one setting."""

    def __init__(
        self, setting: Setting, store: Store, jobs: int, isolation: str = "", params: str = ""
    ) -> None:
        """Prepare to grade.

        Args:
            setting: of all replays.
            store: for the drives.
            jobs: the number of replays at the same time.
            isolation: what is missing in the isolation of the nodes; "" if nothing.
            params: the file with the parameters of the node, in the package of each submission; ""
                for none.
        """
        self._setting, self._store, self._jobs, self._params = setting, store, jobs, params
        self._judges = judges()
        grid = setting.grid
        world = grid and (grid.cells.tobytes(), grid.cells.shape, grid.resolution, grid.origin)
        fields = (setting.car, setting.parameters, setting.mux, setting.remap)
        version = ElementTree.parse(package_folder("package.xml")).findtext("version")
        self._common = hash_of(*fields, world, isolation, params, version)

    def run(self, tasks: Sequence[Task]) -> Generator[Tuple[Grade, bool], None, None]:
        """Grade submissions; yield each result, and whether it is new, as soon as it is known.

        Each new drive is stored before its result is yielded.

        Raises:
            ReplayError: nodes cannot run here.
            OSError: a drive cannot be stored.
        """
        with self._judges:
            for task in tasks:
                self._begin(task)
            yield from self._judged([task for task in tasks if not task.missing])
            due = [task for task in tasks if task.missing]
            if due:
                probe(due[0].plans[due[0].missing[0]], self._setting)
            yield from self._drive_all(due)

    def _drive_all(self, due: Sequence[Task]) -> Iterator[Tuple[Grade, bool]]:
        """Drive all that is missing; yield results as `run`."""
        futures: Dict[Future[StoredDrive], Tuple[Task, str]] = {}
        builds: List[Future[str]] = []
        with ThreadPoolExecutor(self._jobs) as pool:
            for task in due:
                builds.append(pool.submit(build, task.submission, self._setting))
                for name in task.missing:
                    futures[pool.submit(self._drive, task, name, builds[-1])] = task, name
            try:
                for future in as_completed(futures):
                    task, name = futures[future]
                    try:
                        task.drives[name] = future.result()
                    except (UserError, OSError) as failure:
                        task.error = task.error or f"{name}: {failure}"
                        del task.drives[name]
                    if not task.missing:
                        yield from self._judged([task])
            finally:
                for built in builds:
                    built.cancel()
                for future in futures:
                    future.cancel()
                # If this was interrupted, the nodes end, too. A replay that is killed is repeated.
                while any(future.running() for future in futures):
                    for process in multiprocessing.active_children():
                        process.kill()
                    time.sleep(_KILL_PERIOD)

    def _begin(self, task: Task) -> None:
        """Find the stored drives of a submission that are still valid."""
        submission, stored = task.submission, self._store.load(task.submission.name)
        if stored is None:  # so that --merge notices an interruption
            self._store.save(task.old)
        task.old = stored or task.old
        old = {each.plan: each for each in task.old.drives}
        if not submission.fault:
            files = hash_of_folder(submission.folder)
            for name, plan in task.plans.items():
                with open(plan.path, "rb") as file:
                    parts = (files, file.read(), type(plan).__name__, self._common)
                new = StoredDrive(name, hash_of(*parts), "", None)
                is_used = name in old and old[name].key == new.key
                task.drives[name] = old[name] if is_used else new

    def _drive(self, task: Task, name: str, built: "Future[str]") -> StoredDrive:
        """Replay a plan with a submission that has been built.

        Raises:
            UserError, OSError: the replay has no verdict.
        """
        submission, drive = task.submission, task.drives[name]
        if fault := built.result():
            return drive._replace(fault=_shortened(fault, submission))
        try:
            command = (*submission.command, *self._parameters(submission))
        except UserError as error:
            return drive._replace(fault=_shortened(str(error), submission))
        plan, folder, packages = task.plans[name], submission.folder, submission.packages
        recorded = record(Job(submission.name, command, plan, self._setting, folder, packages))
        texts: Dict[str, Any] = {
            each: _shortened(getattr(recorded, each), submission) for each in _TEXTS
        }
        plan = recorded.plan._replace(path=os.path.basename(recorded.plan.path))
        return drive._replace(recorded=recorded._replace(plan=plan, **texts))

    def _parameters(self, submission: Submission) -> Tuple[str, ...]:
        """Return the parameters in the file of a submission; raise UserError if it is wrong."""
        if not self._params:
            return ()
        node = submission.command[0]
        own = [each for each in submission.packages if node.startswith(f"{each}/")]
        return parameter_words(os.path.join(*[*own, submission.folder][:1], self._params))

    def _judged(self, ready: Sequence[Task]) -> Iterator[Tuple[Grade, bool]]:
        """Store what is new of submissions that have been driven; yield their results."""
        grades = [*map(_grade_of, ready)]
        are_new = [bool(each.error) for each in grades]
        for number, (task, grade) in enumerate(zip(ready, grades)):
            if _without_recordings(grade) != _without_recordings(task.old):
                self._store.save(grade)
                are_new[number] = True
        yield from zip(judged(grades, self._setting.tolerances, self._judges), are_new)


def _grade_of(task: Task) -> Grade:
    """Return what is to be stored of a submission."""
    submission = task.submission
    drives = tuple(task.drives.values())
    built = "" if task.error else next((each.fault for each in drives if each.fault), "")
    return Grade(
        submission.name,
        submission.students,
        _shortened(submission.fault or built, submission),
        task.error,
        submission.notes,
        _source(submission),
        drives,
    )


def _without_recordings(grade: Grade) -> Grade:
    """Return a result to compare: the key of a drive determines its recording."""
    return grade._replace(drives=tuple(each._replace(recorded=None) for each in grade.drives))


def not_graded(submission: Submission) -> Grade:
    """Return the result of a submission before it is graded."""
    return Grade(submission.name, submission.students, "", "it has not been graded yet")


def _source(submission: Submission) -> str:
    """Return the first MAX_SOURCE bytes of the node as text; "" if there is no node."""
    if not submission.command:
        return ""
    with open(submission.command[0], "rb") as file:
        return file.read(MAX_SOURCE).decode(errors="replace")


def _shortened(text: str, submission: Submission) -> str:
    """Return a text without the folders in which a submission saw its files and the plan."""
    for folder in (submission.folder, f"/tmp/submissions/{submission.name}", "/tmp/plans"):
        text = text.replace(f"{folder}/", "")
    return text
