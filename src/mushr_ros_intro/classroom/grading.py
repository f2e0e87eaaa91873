"""Grade a class: replay each plan with each submission, unless a stored drive is still valid."""

import multiprocessing
import os
import re
import signal
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from typing import Callable, Dict, Generator, Iterator, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.classroom.grader import build, draw, probe
from mushr_ros_intro.classroom.grades import Grade, plan_grade
from mushr_ros_intro.classroom.store import (
    Key,
    Record,
    Store,
    StoredDrive,
    hash_of,
    hash_of_folder,
    recorded_from_json,
    recorded_to_json,
)
from mushr_ros_intro.classroom.submissions import Submission
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.replay.following import judge_drive
from mushr_ros_intro.replay.job import Job, Setting, run_job
from mushr_ros_intro.replay.judge import Judgement
from mushr_ros_intro.replay.reference import Exercise
from mushr_ros_intro.replay.setting import parameter_words

MAX_SOURCE = 100_000
"""Size of the stored part of a node's source [bytes]."""

_LIBRARY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
_NO_INFLUENCE = {"classroom", "browser", "doctor", "authoring"}
"""Folders of the library without influence on a verdict."""


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class Task(NamedTuple):
    """A submission, and the plans that it drives."""

    submission: Submission
    plans: Dict[str, Exercise]
    """By name."""
    is_chosen: bool = True
    """Whether it may be graded now; otherwise its stored result is used as it is."""


class Options(NamedTuple):
    """How a class is graded."""

    jobs: int
    """The number of replays at the same time."""
    drives_again: bool
    """Whether stored drives are not used."""
    judges_again: bool
    """Whether nothing is driven, and all stored drives are judged again."""
    isolation: str
    """What is missing in the isolation of the nodes; "" if nothing."""
    params: str = ""
    """The file with the parameters of the node, in the package of each submission; "" for none."""


_KILL_PERIOD = 0.05
"""Between two looks for replays that are still running after an interruption [s]."""


class _Progress:
    """The grading of one submission."""

    def __init__(self, task: Task, record: Optional[Record]) -> None:
        self.task, self.record = task, record
        self.drives: Dict[str, StoredDrive] = {}
        self.error = ""
        self.needed: Dict[str, Tuple[Key, Optional[StoredDrive]]] = {}
        """The plans that must be driven, or judged again if there is a stored drive."""


class Grading:
    """The grading of a class with one setting."""

    def __init__(
        self, setting: Setting, store: Store, options: Options, shorten: Callable[[str], str]
    ) -> None:
        """Prepare to grade.

        Args:
            setting: of all replays.
            store: for the results.
            options: how the class is graded.
            shorten: removes the paths of this machine from a text.
        """
        self._setting, self._store, self._options = setting, store, options
        self._shorten = shorten
        self._car = car_from(Parameters(setting.parameters))
        # matplotlib is slow and not thread-safe. Ctrl-C is for this process only.
        self._artists = ProcessPoolExecutor(
            len(os.sched_getaffinity(0)),
            multiprocessing.get_context("forkserver"),
            _ignore_interrupts,
        )
        grid = setting.grid
        world = grid and (grid.cells.tobytes(), grid.cells.shape, grid.resolution, grid.origin)
        fields = (setting.car, setting.parameters, setting.mux, setting.remap, setting.timeout)
        self._common = {
            "options": hash_of(*fields, world, options.isolation, options.params),
            "package": hash_of_folder(_LIBRARY, _NO_INFLUENCE),
            "tolerances": hash_of(sorted(setting.tolerances.items())),
        }

    def run(self, tasks: Sequence[Task]) -> Generator[Tuple[Grade, bool], None, None]:
        """Grade submissions; yield each result, and whether it is new, as soon as it is known.

        Each new result is stored before it is yielded.

        Raises:
            ReplayError: nodes cannot run here.
            OSError: a result cannot be stored.
        """
        due = []
        for task in tasks:
            progress = _Progress(task, self._store.load(task.submission.name))
            if progress.record is None:  # so that --merge notices an interruption
                self._store.save(Record(not_graded(task.submission), {}, 0.0))
            if task.is_chosen:
                self._compare(progress)
                if progress.needed:
                    due.append(progress)
                else:
                    yield self._finish(progress)
            else:
                yield _stored(progress), False
        plans = (each.task.plans[name] for each in due for name in each.needed)
        if due and not self._options.judges_again:
            probe(next(plans), self._setting)
        with ThreadPoolExecutor(self._options.jobs) as pool:
            futures = {each[0]: each for progress in due for each in self._start(pool, progress)}
            try:
                for future in as_completed(futures):
                    _, progress, plan = futures[future]
                    try:
                        progress.drives[plan] = future.result()
                    except (UserError, OSError) as failure:
                        progress.error = progress.error or f"{plan}: {failure}"
                    del progress.needed[plan]
                    if not progress.needed:
                        yield self._finish(progress)
            finally:
                for future in futures:
                    future.cancel()
                # If this was interrupted, the nodes end, too. A replay that is killed is repeated.
                while any(future.running() for future in futures):
                    for process in multiprocessing.active_children():
                        process.kill()
                    time.sleep(_KILL_PERIOD)
                self._artists.shutdown()

    def _compare(self, progress: _Progress) -> None:
        """Find the stored drives that are still valid, and what is needed besides them."""
        submission = progress.task.submission
        if submission.fault:
            return
        files = hash_of_folder(submission.folder)
        for name, plan in progress.task.plans.items():
            with open(plan.path, "rb") as file:
                kind = type(plan).__name__, plan.start
                key = Key(files, hash_of(file.read(), kind), **self._common)
            old = progress.record and progress.record.drives.get(name)
            if old and not self._is_usable(old, key):
                old = None
            if old and old.key == key and not self._options.judges_again:
                progress.drives[name] = old
            else:
                progress.needed[name] = key, old

    def _is_usable(self, old: StoredDrive, key: Key) -> bool:
        """Return whether a drive need not be driven again; it may have to be judged again."""
        if self._options.judges_again:
            return old.key[:2] == key[:2]
        is_same = old.key._replace(tolerances=key.tolerances) == key
        return is_same and not self._options.drives_again

    def _start(
        self, pool: ThreadPoolExecutor, progress: _Progress
    ) -> Iterator[Tuple["Future[StoredDrive]", _Progress, str]]:
        """Start what a submission needs; yield each future, and its plan."""
        submission, built = progress.task.submission, None
        for name, (key, old) in progress.needed.items():
            plan = progress.task.plans[name]
            if old is not None:
                future = pool.submit(self._judge_again, old, key, name, plan)
            elif self._options.judges_again:
                future = pool.submit(_cannot_judge)
            else:
                built = built or pool.submit(build, submission, self._setting)
                future = pool.submit(self._drive, submission, built, key, name, plan)
            yield future, progress, name

    def _drive(
        self, submission: Submission, built: "Future[str]", key: Key, name: str, plan: Exercise
    ) -> StoredDrive:
        """Replay a plan with a submission.

        Raises:
            UserError, OSError: the replay has no verdict.
        """
        if fault := built.result():
            return StoredDrive(key, self._shorten(fault), None, {})
        folder, packages = submission.folder, submission.packages
        try:
            command = (*submission.command, *self._parameters(submission))
        except UserError as error:
            return StoredDrive(key, self._shorten(str(error)), None, {})
        job = Job(submission.name, command, plan, self._setting, folder, packages)
        return self._judged(key, name, run_job(job))

    def _parameters(self, submission: Submission) -> Tuple[str, ...]:
        """Return the parameters in the file of a submission; raise UserError if it is wrong."""
        if not self._options.params:
            return ()
        node = submission.command[0]
        own = [each for each in submission.packages if node.startswith(f"{each}/")]
        return parameter_words(os.path.join(*[*own, submission.folder][:1], self._options.params))

    def _judge_again(self, old: StoredDrive, key: Key, name: str, plan: Exercise) -> StoredDrive:
        """Judge a stored drive with the current tolerances."""
        key = old.key._replace(tolerances=key.tolerances)
        if old.fault:
            return old._replace(key=key)
        values = dict(old.recorded)
        title = values.pop("title")
        recorded = recorded_from_json(values, plan, self._car, self._setting.grid)
        judgement = judge_drive(recorded, self._setting.tolerances)
        return self._judged(key, name, judgement._replace(title=title))

    def _judged(self, key: Key, name: str, judgement: Judgement) -> StoredDrive:
        """Return a judged drive, without the paths of this machine."""
        recorded = judgement.recorded
        values = {**recorded_to_json(recorded), "title": judgement.title}
        for text in ("outcome", "output", "error", "title"):
            values[text] = self._shorten(values[text])
        grade = plan_grade(name, judgement, self._shorten)
        pictures = self._artists.submit(draw, grade.drive).result()
        return StoredDrive(key, "", grade._replace(pictures=pictures), values)

    def _finish(self, progress: _Progress) -> Tuple[Grade, bool]:
        """Return the result of a submission, and whether it is new; store a new one."""
        submission, error = progress.task.submission, progress.error
        drives = {
            name: progress.drives[name] for name in progress.task.plans if name in progress.drives
        }
        built = next((each.fault for each in drives.values() if each.fault), "")
        fault = submission.fault or ("" if error else built)
        plans = tuple(each.grade for each in drives.values() if each.grade)
        grade = Grade(
            submission.name,
            submission.students,
            self._shorten(fault),
            self._shorten(error),
            () if fault or error else plans,
            submission.notes,
            _source(submission),
        )
        is_new = progress.record is None or progress.record[:2] != (grade, drives)
        if is_new:
            self._store.save(Record(grade, drives, time.time()))
        return grade, is_new


def _stored(progress: _Progress) -> Grade:
    """Return the stored result of a submission that is not graded now."""
    return progress.record.grade if progress.record else not_graded(progress.task.submission)


def not_graded(submission: Submission) -> Grade:
    """Return the result of a submission before it is graded."""
    return Grade(submission.name, submission.students, "", "it has not been graded yet", ())


def _cannot_judge() -> StoredDrive:
    """Raise the error of a submission whose drive is not stored."""
    raise UserError(
        "there is no stored drive of this submission and this plan as they are now; grade it "
        "without --rejudge"
    )


def _source(submission: Submission) -> str:
    """Return the first MAX_SOURCE bytes of the node as text; "" if there is no node."""
    if not submission.command:
        return ""
    with open(submission.command[0], "rb") as file:
        return file.read(MAX_SOURCE).decode(errors="replace")


def shortener(workspace: str, folders: Dict[str, str]) -> Callable[[str], str]:
    """Return a function that removes the paths of this machine from a text.

    Args:
        workspace: the folder with the submissions. The paths of their files become relative to
            their own folders.
        folders: other folders, and what replaces each of them with the slash after it.
    """
    names = {os.path.join(path, ""): text for path, text in folders.items()}
    names.update({os.path.join(os.path.realpath(path), ""): text for path, text in folders.items()})
    names.pop("/", None)
    known = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    # In namespaces, a node sees its files in /tmp.
    own = rf"(?:{re.escape(workspace)}|/tmp/submissions)/[^/\s]+/|/tmp/plans/"
    pattern = re.compile(rf"{own}|({known})" if known else own)
    return lambda text: pattern.sub(lambda match: names.get(match[0], ""), text)
