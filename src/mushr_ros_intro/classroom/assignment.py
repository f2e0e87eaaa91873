"""Find out what is graded, and how: the submissions, the plans of each of them, the setting."""

import argparse
import os
from typing import Dict, List, Optional, Sequence, Set

from mushr_ros_intro.classroom.arguments import read_exercises
from mushr_ros_intro.classroom.grades import find_name, names_of
from mushr_ros_intro.classroom.grading import Task
from mushr_ros_intro.classroom.own_plans import TABLE, OwnPlans
from mushr_ros_intro.classroom.submissions import Submission, check_authors
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.replay.following import TOLERANCE_UNITS
from mushr_ros_intro.replay.job import Setting
from mushr_ros_intro.replay.reference import Exercise, refuse_walls
from mushr_ros_intro.replay.setting import parameter_words, read_setting
from mushr_ros_intro.wording import counted


class Plans:
    """The plans, or the paths, that the command line names."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Read the plans.

        Raises:
            UserError: a plan is missing, has faults, or is in a submission.
        """
        self._common = read_exercises(arguments, arguments.plans or [])
        self._own: Optional[OwnPlans] = None
        self.names = list(self._common)
        self._all = list(self._common.values())
        if arguments.plans_for:
            self._own = OwnPlans(arguments.plans_for)
            if self._own.name in self.names:
                text = f"there are two plans with the name '{self._own.name}'"
                raise UserError(f"--plans-for {arguments.plans_for}: {text}; rename the folder")
            self.names.append(self._own.name)
            self._all += self._own.plans
        check_authors(self._all, arguments.inputs)

    @property
    def folders(self) -> List[str]:
        """The folders of the plans."""
        return sorted({os.path.dirname(plan.path) for plan in self._all})

    def check_map(self, setting: Setting) -> None:
        """Refuse a plan or a path that hits a wall, or leaves the map: no node can pass it.

        Raises:
            UserError: there is one.
        """
        refuse_walls(self._all, setting.parameters, setting.grid)

    def task(self, submission: Submission, is_chosen: bool) -> Task:
        """Return the grading of a submission; it fails if there is no plan for its students."""
        plans: Dict[str, Exercise] = dict(self._common)
        error = ""
        if self._own and (plan := self._own.find(submission)):
            plans[self._own.name] = plan
        elif self._own:
            names = [each for student in submission.students for each in student if each]
            shown = ", ".join(names or [submission.name])
            error = f"{self._own.name}/{TABLE} has no plan for {shown}, or two; expected one line"
        return Task(submission, plans, error, is_chosen)


def names_to_grade(arguments: argparse.Namespace, found: Sequence[Submission]) -> Set[str]:
    """Return the names of the submissions that may be graded now; the others keep their results.

    Raises:
        UserError: --only names a submission that is not among them, or there must be one
            submission and there are several.
    """
    if len(found) != 1 and arguments.gradescope:
        raise UserError(f"found {counted(len(found), 'submission')}; --gradescope needs one")
    names = names_of({each.name: each.students for each in found})
    only = {find_name(each, names, "--only: ") for each in arguments.only}
    return only or set(names.values())


def setting_from(arguments: argparse.Namespace, sandbox: Sandbox) -> Setting:
    """Return the setting that the command line describes."""
    own = arguments.node and arguments.params  # each submission has a file of its own
    words = parameter_words(arguments.params) if own else ()
    values = ((name, getattr(arguments, f"{name}_tolerance")) for name in TOLERANCE_UNITS)
    return read_setting(
        package_folder("."),
        arguments.car,
        arguments.map,
        None,
        remap=(*arguments.remap, *words),
        timeout=arguments.timeout,
        tolerances={name: value for name, value in values if value is not None},
        sandbox=sandbox,
        ros=sandbox.copy_workspaces(),
    )
