"""Find out what is graded, and how: the submissions, the plans of each of them, the setting."""

import argparse
import os
from functools import partial
from typing import Dict, List, Mapping, Optional, Sequence

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.classroom.arguments import read_exercises
from mushr_ros_intro.classroom.drawn_plans import DRAWN, draw_plan
from mushr_ros_intro.classroom.submissions import Submission
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.plan.write import plan_text
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.replay.job import Setting
from mushr_ros_intro.replay.reference import Exercise, refuse_walls
from mushr_ros_intro.replay.setting import parameter_words, read_setting


class Plans:
    """The plans, or the paths, that the command line names."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Read the plans.

        Raises:
            UserError: a plan is missing, has faults, or is in a submission.
        """
        self._named = read_exercises(arguments, arguments.plans or [])
        self._like: Optional[Plan] = None
        self._secret = arguments.secret
        self.names = list(self._named)
        if DRAWN in (arguments.plans or []):
            if DRAWN in self.names:
                raise UserError(f"there are two plans with the name '{DRAWN}'; rename the file")
            named = [each for each in self._named.values() if isinstance(each, Plan)]
            test_drive = os.path.join(package_folder("plans"), "test_drive.txt")
            self._like = named[0] if named else read_plan(test_drive)
            self.names.append(DRAWN)
        self._refuse_plans_of_submissions(arguments.inputs)

    def _refuse_plans_of_submissions(self, submissions: Sequence[str]) -> None:
        """Raise UserError if a plan is in a submission, whose author may have written it.

        The current directory, where a name such as figure_8 is searched, may be a submission.
        """
        known = package_folder("plans")
        folders = tuple(os.path.join(os.path.realpath(each), "") for each in submissions)
        for path in (os.path.realpath(plan.path) for plan in self._named.values()):
            if os.path.dirname(path) != known and path.startswith(folders):
                text = f"{path}: this plan is in a submission; expected the path of another one"
                raise UserError(f"{text}, such as {known}/figure_8.txt")

    @property
    def paths(self) -> List[str]:
        """The files of the plans; a drawn plan has none yet."""
        return [plan.path for plan in self._named.values()]

    def check_map(self, setting: Setting) -> None:
        """Refuse a plan or a path that hits a wall, or leaves the map: no node can pass it.

        Raises:
            UserError: there is one.
        """
        refuse_walls(self._named.values(), setting.parameters, setting.grid)

    def of(self, submission: Submission, setting: Setting) -> Dict[str, Exercise]:
        """Return the plans of a submission by name; write the drawn one to the workspace.

        Raises:
            UserError: no plan can be drawn.
        """
        if self._like is None:
            return self._named
        car, grid = car_from(Parameters(setting.parameters)), setting.grid
        check_plan = partial(check, car_name=setting.car, car=car, grid=grid)
        plan = draw_plan(self._like, self._secret, submission.name, check_plan, grid)
        folder = os.path.join(os.path.dirname(submission.folder), f".{DRAWN}-{submission.name}")
        os.mkdir(folder, 0o700)  # other nodes must not read it
        path = os.path.join(folder, f"{DRAWN}.txt")
        with open(path, "w", encoding="ascii") as file:
            file.write(plan_text(plan.start, plan.rows))
        return {**self._named, DRAWN: read_plan(path)}


def setting_from(
    arguments: argparse.Namespace, sandbox: Sandbox, tolerances: Mapping[str, float]
) -> Setting:
    """Return the setting that the command line describes."""
    own = arguments.node and arguments.params  # each submission has a file of its own
    words = parameter_words(arguments.params) if own else ()
    return read_setting(
        package_folder("."),
        arguments.car,
        arguments.map,
        remap=(*arguments.remap, *words),
        tolerances=tolerances,
        sandbox=sandbox,
        ros=sandbox.copy_workspaces(),
    )
