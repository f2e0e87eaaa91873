"""Judge a replay in which a controller follows a path.

The car counts as following the path from its start to its end: each driven pose is compared with
the nearest point that is not far from the one before along the path. So a path may cross itself.
"""

import math
from typing import Any, Callable, Iterator, List, Mapping, NamedTuple, Tuple

import numpy as np

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.judge import CHECKS, Judgement, checked, judge, missing_module
from mushr_ros_intro.replay.recording import Drive, Recorded, frechet_distance
from mushr_ros_intro.replay.reference import STEP, Reference, lengths, resampled
from mushr_ros_intro.replay.tolerances import default_tolerances
from mushr_ros_intro.stamps import NANOSECONDS

AHEAD, BEHIND = 2.0, 0.5
"""How far ahead and behind of the last nearest point the next one is searched [m]."""

LOOK_AHEAD = 1.0
"""A controller steers towards the path so far ahead of the nearest point [m]."""

MOST = 0.9
"""If a larger share of the commands steers away from the path, the sign is wrong."""

EXTRA_TIME = 5.0
"""A car may start late, and become slower at the end [s]."""


class FollowTolerances(NamedTuple):
    """What a controller must keep."""

    position: float = 0.5
    """Distance of the last position from the end of the path [m]."""
    path: float = 0.4
    """Discrete Frechet distance of the driven path [m]."""
    cross_track: float = 0.4
    """Largest distance from the path [m]."""
    rms: float = 0.2
    """Root mean square of the distance from the path [m]."""
    time: float = 1.5
    """Duration of the drive, as a multiple of that of the path; EXTRA_TIME is added."""
    steering_rate: float = 3.2
    """Mean rate of the commanded steering angle [rad/s]; MuSHR's servo is not faster."""


def judge_drive(recorded: Recorded, changes: Mapping[str, float]) -> Judgement:
    """Return the verdict on a replay, given the tolerances that differ from the default."""
    if not isinstance(recorded.plan, Reference):
        return judge(recorded, default_tolerances(recorded.plan, recorded.car)._replace(**changes))
    notes = tuple(_notes(recorded))
    judgement = Judgement(recorded, _drive(recorded), FollowTolerances(**changes), notes=notes)
    judgement = judgement._replace(checks=tuple(checked(judgement, _CHECKS)))
    if all(each.passed for each in judgement.checks if each.name in ("path", "cross_track")):
        return judgement
    return judgement._replace(notes=notes + tuple(_wrong_ways(judgement)))


def _notes(recorded: Recorded) -> Iterator[str]:
    """Yield which common mistakes of a controller its commands show, or a missing module."""
    yield from missing_module(recorded)
    if recorded.ignored:
        yield f"the car ignored {recorded.ignored}"
    sent, valid = recorded.sent, recorded.car.command_timeout
    periods = np.diff([each.arrived for each in sent if each.speed])
    if len(periods) and np.median(periods) > valid:
        yield (
            f"the commands come every {np.median(periods) / NANOSECONDS:.3g} s, but each is valid "
            f"for {valid / NANOSECONDS:g} s: the car stops in between"
        )
    angles = np.array([each.steering_angle for each in sent])
    if len(angles) and np.percentile(np.abs(angles), 90) > 1.0:
        yield "most steering angles are larger than 1; expected radians, not degrees"
    if sent and not any(each.speed for each in sent):
        yield "the node sent only stops"


def _wrong_ways(judgement: Judgement) -> Iterator[str]:
    """Yield what a car that leaves the path does the wrong way around."""
    recorded, limit = judgement.recorded, judgement.tolerances.cross_track
    path = resampled(np.array(recorded.plan.poses), STEP / 5.0)
    sent = [each for each in recorded.sent if each.speed]
    if not sent:
        return
    (dx, dy, _), theta = path[1] - path[0], path[0, 2]
    way = math.cos(theta) * dx + math.sin(theta) * dy
    if way * sent[0].speed < 0.0:
        names = ("backward", "forward") if way > 0.0 else ("forward", "backward")
        yield "the car drives {} at first; the path leads {}".format(*names)
    instants = np.searchsorted(recorded.stamps, [each.arrived for each in sent])
    poses = recorded.poses[np.minimum(instants, len(recorded.poses) - 1)]
    nearest = np.array(_nearest(path, poses))
    is_away = np.hypot(*(path[nearest] - poses)[:, :2].T) > limit
    count = int(np.argmax(is_away))  # later, the nearest point can be behind the car
    ahead = path[np.minimum(nearest + int(LOOK_AHEAD / STEP * 5.0), len(path) - 1)]
    (x, y, _), thetas = (ahead - poses).T, poses[:, 2]
    lefts = np.cos(thetas) * y - np.sin(thetas) * x
    turns = ([each.steering_angle for each in sent] * lefts)[:count]
    wrong = np.mean(turns[turns != 0.0] < 0.0) if turns.any() else 0.0
    if wrong >= MOST:
        yield (
            f"until the car is {limit:g} m from the path, {wrong:.0%} of the commands steer away "
            "from it: a positive angle turns left, and the first point of the path is its start"
        )


def _nearest(path: np.ndarray, poses: np.ndarray) -> List[int]:
    """Return the index of the nearest point of a path for each pose, one after another.

    Args:
        path: its points are STEP / 5 apart; N x 3.
        poses: M x 3.
    """
    indices, index = [], 0
    for pose in poses:
        begin = max(0, index - int(BEHIND / STEP * 5.0))
        window = path[begin : index + int(AHEAD / STEP * 5.0) + 1, :2]
        index = begin + int(np.argmin(np.hypot(*(window - pose[:2]).T)))
        indices.append(index)
    return indices


def _drive(recorded: Recorded) -> Drive:
    """Return the driven path and the nearest points of the path.

    If the car has not reached the end of the path, the rest of the path is compared with its last
    pose.
    """
    moves = np.nonzero(np.diff(recorded.poses, axis=0).any(axis=1))[0]
    first, last = (int(moves[0]), int(moves[-1]) + 2) if len(moves) else (0, 1)
    driven, times = recorded.poses[first:last], recorded.stamps[first:last] - recorded.stamps[first]
    path = resampled(np.array(recorded.plan.poses), STEP / 5.0)
    indices = _nearest(path, driven)
    indices += range(indices[-1] + 5, len(path), 5)
    more = len(indices) - len(driven)
    seconds = times / NANOSECONDS
    seconds = np.append(seconds, seconds[-1] + 0.02 * np.arange(1, more + 1))
    distance = frechet_distance(resampled(driven)[:, :2], path[::5, :2])
    driven = np.concatenate([driven, np.repeat(driven[-1:], more, axis=0)])
    return Drive(seconds, driven, path[indices], distance)


def _path(judgement: Judgement) -> Tuple[bool, str]:
    distance, limit = judgement.drive.frechet_distance, judgement.tolerances.path
    text = f"the Frechet distance of the driven path is {distance:.3f} m; tolerance {limit:g} m"
    return distance <= limit, text


def miss_of(judgement: Judgement) -> float:
    """Return how far the car ended from the end of the path, also along the path [m]."""
    _, driven, passed, _ = judgement.drive
    rest = passed[(driven == driven[-1]).all(axis=1), :2]
    last = Pose(*driven[-1])
    return max(last.distance_to(judgement.recorded.plan.poses[-1]), float(lengths(rest)[-1]))


def _if_it_arrives(check: "_Check") -> "_Check":
    """Return a check that fails if the car does not stop at the end: it proves nothing then."""

    def judged(judgement: Judgement) -> Tuple[bool, str]:
        poses = judgement.recorded.poses
        if miss_of(judgement) > judgement.tolerances.position or (poses == poses[0]).all():
            return False, "the car did not stop at the end of the path"
        return check(judgement)

    return judged


def _cross_track(judgement: Judgement) -> Tuple[bool, str]:
    errors, limits = judgement.drive.distances, judgement.tolerances
    largest, rms = float(np.max(errors)), float(np.sqrt(np.mean(errors**2)))
    text = (
        f"the distance from the path is at most {largest:.3f} m, rms {rms:.3f} m; "
        f"tolerances {limits.cross_track:g} m and {limits.rms:g} m"
    )
    return largest <= limits.cross_track and rms <= limits.rms, text


def _final_pose(judgement: Judgement) -> Tuple[bool, str]:
    end, limit = Pose(*judgement.drive.driven[-1]), judgement.tolerances.position
    miss = miss_of(judgement)
    text = f"the car ended {miss:.3f} m from the end of the path, at {end}; tolerance {limit:g} m"
    return miss <= limit, text


def _time(judgement: Judgement) -> Tuple[bool, str]:
    moves = np.nonzero(np.diff(judgement.recorded.poses, axis=0).any(axis=1))[0]
    stamps = judgement.recorded.stamps
    seconds = float(stamps[moves[-1] + 1] - stamps[moves[0]]) / NANOSECONDS
    wanted = judgement.recorded.plan.duration / NANOSECONDS
    limit = judgement.tolerances.time * wanted + EXTRA_TIME
    text = (
        f"the drive takes {seconds:.2f} s; the path {wanted:.2f} s, at most {limit:.2f} s allowed"
    )
    return seconds <= limit, text


def _smoothness(judgement: Judgement) -> Tuple[bool, str]:
    """Judge the mean rate of the steering angle."""
    sent, limit = judgement.recorded.sent, judgement.tolerances.steering_rate
    seconds = (sent[-1].arrived - sent[0].arrived) / NANOSECONDS
    angles = np.array([each.steering_angle for each in sent])
    rate = float(np.sum(np.abs(np.diff(angles)))) / seconds if seconds else 0.0
    text = f"the mean steering rate is {rate:.2f} rad/s, tolerance {limit:g} rad/s"
    return rate <= limit, text


_Check = Callable[[Judgement], Tuple[bool, str]]

_CHECKS: Mapping[str, Callable[[Judgement], Any]] = {
    "topics": CHECKS["topics"],
    "path": _path,
    "cross_track": _cross_track,
    "final_pose": _final_pose,
    "time": _if_it_arrives(_time),
    "smoothness": _if_it_arrives(_smoothness),
    "map": CHECKS["map"],
}
"""As CHECKS."""

FOLLOW_CHECK_NAMES = ("node", *_CHECKS)
"""The names of the checks of a controller."""
