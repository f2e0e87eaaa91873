"""Save a plan while it is being made, and remember what has been saved."""

import itertools
import os
from contextlib import ExitStack
from typing import Optional

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Table, file_name, folder
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.plan import Plan, PlanError
from mushr_ros_intro.plan.write import plan_text
from mushr_ros_intro.preview.prediction import length
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted


def plan_file_parameters(name: str) -> Table:
    """Return the parameters of a node that saves plans in a folder; `name` is that of the file."""
    return (
        folder("folder", ".", "folder of the plans; . is the directory of your shell"),
        file_name("name", name, "if the file exists, a number is added to the name"),
    )


class PlanFile:
    """The file with a name that a plan is saved in; a new one in the folder each time."""

    def __init__(self, path: str, name: str) -> None:
        self._folder, self._name = path, name
        self._saved: Optional[Plan] = None
        self._last = ""  # path and size of that plan

    def destination(self) -> str:
        """Return a clause that names the folder, and says if it cannot be written to."""
        text = f"plans go to {self._folder}"
        if os.access(self._folder, os.W_OK | os.X_OK):
            return text
        text += (
            ", but you cannot write there: choose another folder with _folder:=PATH of rosrun, or "
        )
        return f"{text}folder:=PATH of web.launch"

    def save(self, plan: Optional[Plan], if_empty: str) -> str:
        """Write a plan into a new file; return a message with its path and size.

        An existing file is not overwritten: the name of the new file gets a number. If writing
        fails, the incomplete file is removed.

        Raises:
            UserError: the file cannot be written, `read_plan` would refuse it, or the plan has no
                rows; `if_empty` is then the reason.
        """
        if plan is None or not plan.rows:
            raise UserError(f"nothing saved: {if_empty}")
        data = plan_text(plan.start, plan.rows).encode()
        stem, ending = os.path.splitext(self._name)
        numbered = (f"{stem}_{number}{ending}" for number in itertools.count(2))
        paths = (
            os.path.join(self._folder, each) for each in itertools.chain([self._name], numbered)
        )
        path = next(each for each in paths if not os.path.lexists(each))
        try:
            parse_plan(data, self._name)
            with open(path, "xb") as file, ExitStack() as undo:
                undo.callback(os.unlink, path)
                file.write(data)
                file.flush()
                undo.pop_all()
        except PlanError as error:
            text = f"nothing saved: this is no plan that can be driven: {error}"
            raise UserError(text) from None
        except OSError as error:
            text = f"nothing saved: {path} cannot be written ({error.strerror})"
            raise UserError(text) from None
        self._saved, self._last = plan, f"{path}; {summary(plan)}"
        return f"saved {self._last}"

    def finish(self, plan: Optional[Plan], if_empty: str) -> str:
        """Write a plan unless it is saved; return a message: what was written, or why nothing.

        Raises:
            UserError: it cannot be written.
        """
        if not self.is_saved(plan):
            return self.save(plan, if_empty)
        if self._last:
            return f"nothing new to save; saved before: {self._last}"
        return f"nothing saved: {if_empty}"

    def is_saved(self, plan: Optional[Plan]) -> bool:
        """Return whether a plan has no rows, or is the one that was saved last."""
        return plan is None or not plan.rows or plan == self._saved


def summary(plan: Plan) -> str:
    """Return the number of rows, the length [m] and the duration [s] of a plan, as text."""
    rows, seconds = counted(len(plan.rows), "row"), plan.duration / NANOSECONDS
    return f"the plan has {rows}, {length(plan):.3f} m, {seconds:.3f} s"
