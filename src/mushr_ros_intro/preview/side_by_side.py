"""Drive cars without noise side by side, as numpy arrays."""

import math
from typing import Tuple, Union

import numpy as np


def ramped(
    begin: np.ndarray, end: np.ndarray, reach: Union[float, np.ndarray]
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the mean and the last value of a ramp towards `end` that changes by up to `reach`."""
    last = np.clip(end, begin - reach, begin + reach)
    change = last - begin
    return last - 0.5 * change * np.abs(change) / reach, last


def arcs(
    distance: np.ndarray, angle: np.ndarray, wheelbase: Union[float, np.ndarray]
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the chord [m] and the turn [rad] of arcs; see `geometry.drive_arc`.

    Args:
        distance: along the arc [m].
        angle: the steering angle [rad].
        wheelbase: [m].
    """
    turn = distance * np.tan(angle) / wheelbase
    return distance * np.sinc(0.5 * turn / math.pi), turn
