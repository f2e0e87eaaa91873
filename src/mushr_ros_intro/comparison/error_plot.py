"""Write the files of a comparison: the paths as a table, and two pictures."""

import os

import numpy as np
from matplotlib.figure import Figure

from mushr_ros_intro.comparison.comparison import Comparison
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.preview import drawing
from mushr_ros_intro.replay.pictures import locations
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.replay.report_files import write_trajectory


def write_files(folder: str, found: Comparison) -> None:
    """Write trajectory.csv, path.png and errors.png of a drive into a folder.

    Raises:
        UserError: the folder or a file cannot be written.
    """
    title = f"{os.path.basename(found.log.name)}: final error {found.sizes[-1]:.3f} m"
    drive = Drive(found.times, found.driven, found.predicted, float("nan"))
    seconds = np.searchsorted(found.times, np.arange(1.0, found.times[-1])).tolist()
    path = locations(drive, title, error_indices=[*seconds, len(found.times) - 1])
    try:
        os.makedirs(folder, exist_ok=True)
        write_trajectory(folder, drive, found.plan.start)
        path.savefig(os.path.join(folder, "path.png"), dpi=120)
        errors(found, title).savefig(os.path.join(folder, "errors.png"), dpi=120)
    except OSError as error:
        text = f"{error.filename or folder} cannot be written ({error.strerror})"
        raise UserError(f"--out: {text}; expected a folder") from None


def errors(found: Comparison, title: str) -> Figure:
    """Return a drawing of the parts of the error, over the predicted distance."""
    figure, (axes,) = drawing.new_figure(8.0, 4.0)
    along, across = found.errors.T
    axes.plot(found.distances, along, color="C2", label="along the path, forward")
    axes.plot(found.distances, across, color="C5", label="across the path, left")
    axes.plot(found.distances, found.sizes, "--", color=drawing.ERROR, label="size")
    axes.set(xlabel="predicted distance [m]", ylabel="driven minus predicted [m]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    drawing.set_title(axes, title)
    return figure
