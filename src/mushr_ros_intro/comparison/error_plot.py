"""Draw a comparison: both paths with the error once per second, and the error over the distance."""

import os
from typing import List

import numpy as np
from matplotlib.figure import Figure

from mushr_ros_intro.comparison.comparison import Comparison
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.preview import drawing
from mushr_ros_intro.replay import pictures
from mushr_ros_intro.replay.recording import Drive


def write(folder: str, found: Comparison, number: int) -> List[str]:
    """Write both pictures of a drive into a folder; return their paths.

    Raises:
        UserError: the folder or a file cannot be written.
    """
    files = []
    try:
        os.makedirs(folder, exist_ok=True)
        for name, figure in (("path", path(found)), ("errors", errors(found))):
            files.append(os.path.join(folder, f"{name}_{number}.png"))
            figure.savefig(files[-1], dpi=120)
    except OSError as error:
        text = f"{error.filename or folder} cannot be written ({error.strerror})"
        raise UserError(f"--out: {text}; expected a folder") from None
    return files


def path(found: Comparison) -> Figure:
    """Return a drawing of the predicted and the driven path."""
    times = found.times
    seconds = np.searchsorted(times, np.arange(1.0, times[-1])).tolist()
    drive = Drive(times, found.driven, found.predicted, float("nan"))
    return pictures.locations(drive, _title(found), error_indices=[*seconds, len(times) - 1])


def errors(found: Comparison) -> Figure:
    """Return a drawing of the parts of the error, over the predicted distance."""
    figure, (axes,) = drawing.new_figure(8.0, 4.0)
    along, across = found.errors.T
    axes.plot(found.distances, along, color="C2", label="along the path, forward")
    axes.plot(found.distances, across, color="C5", label="across the path, left")
    axes.plot(found.distances, found.sizes, "--", color=drawing.ERROR, label="size")
    axes.set(xlabel="predicted distance [m]", ylabel="driven minus predicted [m]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    drawing.set_title(axes, _title(found))
    return figure


def _title(found: Comparison) -> str:
    """Return the name of the drive, and its final error."""
    return f"{os.path.basename(found.log.name)}: final error {found.sizes[-1]:.3f} m"
