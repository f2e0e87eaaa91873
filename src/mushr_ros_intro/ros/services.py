"""Services without arguments."""

from typing import Any, Callable, ContextManager

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mushr_ros_intro.errors import UserError


def offer(name: str, lock: ContextManager[Any], act: Callable[[], str]) -> None:
    """Offer a std_srvs/Trigger service.

    Args:
        name: of the service.
        lock: held while `act` runs.
        act: returns the message of the response, which is logged, too. A UserError that it raises
            becomes the message of a response without success.
    """

    def handle(_: TriggerRequest) -> TriggerResponse:
        try:
            with lock:
                message = act()
        except UserError as error:
            return TriggerResponse(False, str(error))
        rospy.loginfo("%s", message)
        return TriggerResponse(True, message)

    rospy.Service(name, Trigger, handle)
