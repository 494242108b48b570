"""The calls of a rig for asyncio.

::

    async with hilrig.aio.rig("robot.toml") as r:
        async with r.fault("wheels", direction="to-device", kind="cut"):
            assert await r.wait({"axis": {"name": "left", "op": "==", "value": 0}}, "2s")

Each call has a connection of its own, so several of them can wait at the same time.
"""

from __future__ import annotations

import asyncio
import functools
from contextlib import asynccontextmanager
from typing import Any, AsyncIterator, Callable, Dict, Mapping, Union

from .bench import Bench
from .control import Control
from .result import Result
from .rig import Rig, Running
from .session import PathLike, Session


class AsyncRig:
    """A running rig whose calls do not block the event loop."""

    def __init__(self, rig: Session) -> None:
        #: The same rig with calls that block.
        self.rig = rig

    def port(self, name: str) -> str:
        """The path of a port."""
        return self.rig.port(name)

    @asynccontextmanager
    async def fault(self, link: Union[str, None] = None, **keys: Any) -> AsyncIterator[int]:
        """A fault as ``Session.fault`` adds it, for an ``async with`` block; gives its number."""
        fault = {key.rstrip("_"): value for key, value in keys.items()}
        fault.update({} if link is None else {"link": link})
        number = int((await self.ask("add", fault=fault))["id"])
        try:
            yield number
        finally:
            await self.ask("end", id=number)

    async def wait(self, condition: Mapping[str, Any], timeout: str = "10s") -> bool:
        """Waits until ``condition`` holds; ``timeout`` is rig time."""
        answer = await self.ask("wait", **{"for": dict(condition)}, timeout=timeout)
        return bool(answer["held"])

    async def state(self) -> Dict[str, Any]:
        """The current state of the robot."""
        return await self.ask("state")

    async def finish(self) -> Result:
        """Ends the run as ``Session.finish``, and returns the verdict."""
        return await asyncio.to_thread(self.rig.finish)

    async def ask(self, do: str, **keys: Any) -> Dict[str, Any]:
        """Sends one request of docs/control.md and returns its answer."""
        return await asyncio.to_thread(_ask, self.rig, do, keys)


def _ask(rig: Session, do: str, keys: Mapping[str, Any]) -> Dict[str, Any]:
    control = Control(rig.dir)
    try:
        return control.ask(do, **keys)
    finally:
        control.close()


@asynccontextmanager
async def _started(start: Callable[[], Session]) -> AsyncIterator[AsyncRig]:
    rig = await asyncio.to_thread(start)
    try:
        yield AsyncRig(rig)
    finally:
        await asyncio.to_thread(rig.close)


def rig(scenario: PathLike, **settings: Any) -> Any:
    """``Rig`` for an ``async with`` block."""
    return _started(functools.partial(Rig, scenario, **settings))


def start(scenario: PathLike, program: str, **settings: Any) -> Any:
    """``Running`` for an ``async with`` block."""
    return _started(functools.partial(Running, scenario, program, **settings))


def device(description: PathLike, **settings: Any) -> Any:
    """``Bench`` for an ``async with`` block."""
    return _started(functools.partial(Bench, description, **settings))
