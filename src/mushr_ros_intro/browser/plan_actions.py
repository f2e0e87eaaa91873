"""Answer the requests of the page about plans and drives."""

from typing import Any, Dict, Sequence

from mushr_ros_intro.browser import plans, rosapi
from mushr_ros_intro.browser.bridge import Bridge
from mushr_ros_intro.browser.map import WebMap
from mushr_ros_intro.browser.plan_drive import PlanDrive
from mushr_ros_intro.browser.server import Action
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.simulator.car_parameters import (
    COLLISION,
    FOOTPRINTS,
    simulated_car_parameters,
)


class PlanActions:
    """What the server answers about plans and drives."""

    def __init__(
        self,
        bridge: Bridge,
        web_map: WebMap,
        drive: PlanDrive,
        folders: Sequence[str],
        parameters: Dict[str, Any],
    ) -> None:
        """Set up the actions.

        Args:
            bridge: runs what takes time in a thread.
            web_map: the map for checks of plans.
            drive: drives the plans.
            folders: contain the plans.
            parameters: of path_publisher.py, the same for each drive; with car_name.
        """
        self._bridge, self._map, self._drive = bridge, web_map, drive
        self._folders, self._parameters = folders, parameters

    def actions(self) -> Dict[str, Dict[str, Action]]:
        """Return what the server answers, by path and method."""
        return {
            r"/plans/(.+)": {"GET": self._get_plan},
            r"/drive": {"POST": self._start_drive, "DELETE": self._stop_drive},
        }

    async def _get_plan(self, name: str) -> Dict[str, Any]:
        path = await self._path(name)
        return await self._bridge.in_thread(self._check, name, path)

    def _check(self, name: str, path: str) -> Dict[str, Any]:
        try:
            parameters = simulated_car_parameters(self._parameters["car_name"], must_run=True)
        except OSError as error:
            raise UserError(rosapi.no_answer(error)) from None
        footprint = FOOTPRINTS[parameters.get(COLLISION)]
        return plans.describe(name, path, "car", car_from(parameters), self._map.grid, footprint)

    async def _path(self, name: Any) -> str:
        """Return the path of a plan; raise a LookupError if there is none with this name."""
        paths = await self._bridge.in_thread(plans.find_plans, self._folders)
        if not isinstance(name, str) or name not in paths:
            raise LookupError(f"there is no plan {name!r}; expected one of {', '.join(paths)}")
        return paths[name]

    async def _start_drive(self, body: Any) -> Dict[str, Any]:
        options = body if isinstance(body, dict) else {}
        path = await self._path(options.get("plan"))
        parameters = {
            **self._parameters,
            "plan_file": path,
            "loop": bool(options.get("loop")),
        }
        name = options["plan"]
        written = (await self._bridge.in_thread(plans.versions, self._folders)).get(name)
        await self._bridge.in_thread(self._drive.start, name, written, parameters)
        return {}

    async def _stop_drive(self) -> Dict[str, Any]:
        await self._bridge.in_thread(self._drive.stop)
        return {}
