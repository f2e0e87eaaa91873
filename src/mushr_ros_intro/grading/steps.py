"""The steps of the test node muxtest."""

from typing import Any, Dict, List, NamedTuple, Tuple

from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.sim.mux_config import IDLE


class Step(NamedTuple):
    """Some inputs of a mux send at the same time."""

    name: str
    """For messages."""
    send: List[str]
    """The names of the inputs."""
    wins: str
    """The name of the input that should drive, or IDLE."""


def parse_steps(values: Dict[str, Any]) -> Tuple[Dict[str, str], List[Step]]:
    """Return the topics of a mux's inputs by name, and the steps of a test.

    Args:
        values: ``{"inputs": {name: topic, ...}, "steps": [{"send": [name, ...], "wins": name}]}``;
            wins may be idle. Other keys are ignored.

    Raises:
        ParameterError: the values have another form.
    """
    parameters = Parameters(values)
    inputs, steps = values.get("inputs"), values.get("steps")
    if not isinstance(inputs, dict) or not inputs:
        raise parameters.error("inputs", "{name: topic, ...}")
    if not isinstance(steps, list) or not steps:
        raise parameters.error("steps", "a list of {send: [name, ...], wins: name}")
    topics = Parameters(inputs, "~inputs/")
    parsed = []
    for number, step in enumerate(steps, 1):
        step = step if isinstance(step, dict) else {}
        entries = Parameters(step, f"~steps[{number}]/")
        send, wins = step.get("send"), entries.choice("wins", [*inputs, IDLE])
        if not isinstance(send, list) or not all(name in list(inputs) for name in send):
            raise entries.error("send", f"a list of names out of {', '.join(inputs)}")
        parsed.append(Step(f"step {number} (send: [{', '.join(send)}])", send, wins))
    return {name: topics.text(name) for name in inputs}, parsed
