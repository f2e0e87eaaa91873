"""Save a plan while it is being made, and remember what has been saved."""

from typing import Optional

from mushr_ros_intro.errors import counted
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.plan.write import WriteError, write_plan
from mushr_ros_intro.preview.prediction import length
from mushr_ros_intro.sim.stamps import NANOSECONDS


class PlanFile:
    """The file that a plan is saved in, a new one each time.

    Args:
        parameters: ``folder`` is the folder of the file (default: the user's), ``name`` its name.
        default_name: of the file.

    Raises:
        ParameterError: a parameter is wrong.
    """

    def __init__(self, parameters: Parameters, default_name: str) -> None:
        self.folder = parameters.folder("folder", ".")
        self._name = parameters.file_name("name", default_name)
        self._saved: Optional[Plan] = None
        self._last = ""  # path and size of that plan

    def save(self, plan: Optional[Plan], if_empty: str) -> str:
        """Write a plan into a new file; return a message with its path and size.

        Raises:
            WriteError: it cannot be written, or it has no rows; `if_empty` is then the reason.
        """
        if plan is None or not plan.rows:
            raise WriteError(f"nothing saved: {if_empty}")
        try:
            path = write_plan(self.folder, self._name, plan.start, plan.rows)
        except WriteError as error:
            raise WriteError(f"nothing saved: {error}") from None
        self._saved, self._last = plan, f"{path}; {summary(plan)}"
        return f"saved {self._last}"

    def finish(self, plan: Optional[Plan], if_empty: str) -> str:
        """Write a plan unless it is saved; return a message: what was written, or why nothing.

        Raises:
            WriteError: it cannot be written.
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
