"""Draw drives as SVG elements for HTML pages; `STYLE` is the CSS that they need.

The driven path is solid, with a circle at its start and a square at its end. The predicted path
is dashed.
"""

import math
from typing import List, NamedTuple, Tuple

import numpy as np

from mushr_ros_intro.classroom.grades import PlanGrade

STYLE = """
svg { display: block; max-width: 100%; height: auto; }
svg text { fill: currentColor; font: 12px system-ui, sans-serif; }
.grid { stroke: currentColor; stroke-opacity: 0.18; fill: none; }
.driven, .predicted { fill: none; stroke-linejoin: round; stroke: var(--driven); stroke-width: 3; }
.predicted { stroke: var(--predicted); stroke-width: 1.5; stroke-dasharray: 6 6; }
.start { fill: none; stroke: var(--driven); stroke-width: 1.5; }
.end { fill: var(--driven); }
"""

_SMALL = (108.0, 72.0)
"""The size of a small picture [px]."""
_SMALL_POINTS = 60
"""A path of a small picture has at most so many points."""
_WIDTH, _HEIGHTS = 600.0, (160.0, 440.0)
"""The width and the least and largest height of the area of a large drawing [px]."""
_DISTANCES_HEIGHT = 180.0
"""The height of the area of the drawing of distances [px]."""
_LEFT, _TOP, _RIGHT, _BOTTOM = 64.0, 10.0, 16.0, 44.0
"""The space around the area of a large drawing [px]."""
_TICK = 60.0
"""The least distance between two lines of the grid [px]."""
_LEAST_EXTENT = 0.1
"""A drawing shows at least so much of the world [m], so that a standing car does not move."""
_LEAST_DISTANCE = 0.01
"""The axis of distances ends at this distance or above [m]."""


class _View(NamedTuple):
    """An area of a drawing [px] and the part of the plane that it shows."""

    left: float
    top: float
    size: np.ndarray
    low: np.ndarray
    scale: np.ndarray
    """[px] per unit of x and y."""

    @property
    def high(self) -> np.ndarray:
        """The upper right corner of the plane's part."""
        return self.low + self.size / self.scale

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return where points of the plane are in the drawing; y points upwards in the plane."""
        x, y = ((points - self.low) * self.scale).T
        return np.column_stack([self.left + x, self.top + self.size[1] - y])


def picture(plan: PlanGrade) -> str:
    """Return a small picture of a drive, or nothing if there is no drive."""
    _, driven, predicted = _tracks(plan)
    if not len(driven):
        return ""
    view = _equal_view(np.vstack([driven, predicted]), (0.0, 0.0), np.array(_SMALL))
    chosen = np.linspace(0, len(driven) - 1, min(len(driven), _SMALL_POINTS)).astype(int)
    paths = _paths(view, driven[chosen], predicted[chosen])
    return _svg(*_SMALL, "driven and predicted path", paths)


def paths(plan: PlanGrade) -> str:
    """Return a drawing of the paths in the map frame [m], or nothing if there is no drive."""
    _, driven, predicted = _tracks(plan)
    if not len(driven):
        return ""
    both = np.vstack([driven, predicted])
    extent = np.maximum(np.ptp(both, axis=0), _LEAST_EXTENT)
    height = float(np.clip(_WIDTH * extent[1] / extent[0], *_HEIGHTS))
    view = _equal_view(both, (_LEFT, _TOP), np.array([_WIDTH, height]))
    step = _round_step(_TICK / view.scale[0])
    content = _axes(view, (step, step), ("x [m]", "y [m]")) + _paths(view, driven, predicted)
    return _framed(view, "driven and predicted path with axes in m", content)


def distances(plan: PlanGrade) -> Tuple[str, str]:
    """Return a drawing of the distance between the paths over time, and its caption.

    Both are empty if there is no drive.
    """
    times, driven, predicted = _tracks(plan)
    if not len(times):
        return "", ""
    apart = np.hypot(*(driven - predicted).T)
    extent = np.array([max(np.ptp(times), _LEAST_EXTENT), max(1.1 * apart.max(), _LEAST_DISTANCE)])
    size = np.array([_WIDTH, _DISTANCES_HEIGHT])
    view = _View(_LEFT, _TOP, size, np.array([times[0], 0.0]), size / extent)
    steps = tuple(
        _round_step(_TICK * weight / scale) for weight, scale in zip((1, 0.5), view.scale)
    )
    content = _axes(
        view, (steps[0], steps[1]), ("time since the first command [s]", "distance [m]")
    )
    content += _line("driven", view.pixels(np.column_stack([times, apart])))
    largest = int(apart.argmax())
    caption = (
        f"distance between the driven and the predicted position at the same time; the largest is "
        f"{apart[largest]:.3g} m at {times[largest]:.3g} s, the last is {apart[-1]:.3g} m"
    )
    return _framed(view, "distance between the paths over time", content), caption


def _tracks(plan: PlanGrade) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, driven and predicted positions, without those that are not finite."""
    rows = np.column_stack(
        [
            np.array(plan.times, float),
            np.array(plan.driven, float).reshape(-1, 3)[:, :2],
            np.array(plan.predicted, float).reshape(-1, 3)[:, :2],
        ]
    )
    rows = rows[np.isfinite(rows).all(axis=1)]
    return rows[:, 0], rows[:, 1:3], rows[:, 3:5]


def _equal_view(points: np.ndarray, corner: Tuple[float, float], size: np.ndarray) -> _View:
    """Return a view of points with the same scale in both directions, and a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.08 * size.min()
    scale = ((size - 2 * margin) / np.maximum(high - low, _LEAST_EXTENT)).min()
    return _View(*corner, size, (low + high - size / scale) / 2, np.array([scale, scale]))


def _round_step(least: float) -> float:
    """Return the next number above `least` that is 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= least)


def _axes(view: _View, steps: Tuple[float, float], names: Tuple[str, str]) -> str:
    """Return the frame, the grid and the labels of a large drawing."""
    left, top, (width, height) = view.left, view.top, view.size
    right, bottom = left + width, top + height
    parts = [f'<rect class="grid" x="{left}" y="{top}" width="{width}" height="{height:.4g}"/>']
    for axis, step in enumerate(steps):
        first, last = math.ceil(view.low[axis] / step), math.floor(view.high[axis] / step)
        for index in range(first, last + 1):
            label = f"{index * step:.6g}"
            x, y = view.pixels(np.array([[index * step, index * step]]))[0]
            if axis == 0:
                parts.append(f'<path class="grid" d="M{x:.5g},{top}V{bottom:.5g}"/>')
                parts.append(_text(x, bottom + 16, "middle", label))
            else:
                parts.append(f'<path class="grid" d="M{left},{y:.5g}H{right}"/>')
                parts.append(_text(left - 6, y + 4, "end", label))
    parts.append(_text(left + width / 2, bottom + 36, "middle", names[0]))
    x, y = 14.0, top + height / 2
    turned = f' transform="rotate(-90 {x:.5g} {y:.5g})"'
    return "".join([*parts, _text(x, y, "middle", names[1], turned)])


def _text(x: float, y: float, anchor: str, text: str, attributes: str = "") -> str:
    return f'<text x="{x:.5g}" y="{y:.5g}" text-anchor="{anchor}"{attributes}>{text}</text>'


def _paths(view: _View, driven: np.ndarray, predicted: np.ndarray) -> str:
    """Return both paths, with the start and the end of the driven one."""
    driven, predicted = view.pixels(driven), view.pixels(predicted)
    (x, y), (end_x, end_y) = driven[0], driven[-1] - 3.0
    parts: List[str] = [
        _line("driven", driven),
        _line("predicted", predicted),
        f'<circle class="start" cx="{x:.4g}" cy="{y:.4g}" r="6"/>',
        f'<rect class="end" x="{end_x:.4g}" y="{end_y:.4g}" width="6" height="6"/>',
    ]
    return "".join(parts)


def _line(name: str, pixels: np.ndarray) -> str:
    """Return a line through points of a drawing; a single point is no line."""
    points = " ".join(["%.4g,%.4g"] * len(pixels)) % tuple(pixels.ravel().tolist())
    return f'<polyline class="{name}" points="{points}"/>'


def _framed(view: _View, label: str, content: str) -> str:
    width, height = view.size
    return _svg(_LEFT + width + _RIGHT, _TOP + height + _BOTTOM, label, content)


def _svg(width: float, height: float, label: str, content: str) -> str:
    size = f'width="{width:.4g}" height="{height:.4g}" viewBox="0 0 {width:.4g} {height:.4g}"'
    return f'<svg role="img" aria-label="{label}" {size}>{content}</svg>'
