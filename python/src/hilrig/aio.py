"""The calls of a rig for asyncio.

::

    async with hilrig.aio.rig("robot.toml") as r:
        async with r.fault("wheels", direction="to-device", kind="cut"):
            assert await r.wait({"axis": {"name": "left", "op": "==", "value": 0}}, "2s")

Each request has a connection of its own and no thread, so many of them can wait at the same time. A
cancelled request closes its connection.
"""

from __future__ import annotations

import asyncio
import functools
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Any, AsyncIterator, Callable, Dict, Mapping, TypeVar, Union

from .bench import Bench
from .control import answered, encoded, has_ended
from .result import Result
from .rig import Rig, Running
from .session import PathLike, Session

#: Maximum length of an answer, bytes.
ANSWER_MAX = 1 << 26

_Value = TypeVar("_Value")


class AsyncRig:
    """A running rig whose calls do not block the event loop."""

    def __init__(self, rig: Session, thread: Executor) -> None:
        #: The same rig with calls that block.
        self.rig = rig
        self._thread = thread

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
            try:
                await self.ask("end", id=number)
            except (OSError, ValueError) as error:
                # The end of the rig ends its faults, too.
                if not has_ended(error):
                    raise

    async def wait(self, condition: Mapping[str, Any], timeout: str = "10s") -> bool:
        """Waits until ``condition`` holds; ``timeout`` is rig time."""
        answer = await self.ask("wait", **{"for": dict(condition)}, timeout=timeout)
        return bool(answer["held"])

    async def state(self) -> Dict[str, Any]:
        """The current state of the robot."""
        return await self.ask("state")

    async def finish(self) -> Result:
        """Ends the run as ``Session.finish``, and returns the verdict; so does a cancellation."""
        finished = self._thread.submit(self.rig.finish)
        try:
            return await _done(finished)
        except asyncio.CancelledError:
            if not finished.cancel():
                self.rig._hang_up()
            raise

    async def ask(self, do: str, **keys: Any) -> Dict[str, Any]:
        """Sends one request of docs/control.md and returns its answer."""
        try:
            return await self._ask(encoded(do, keys))
        except (OSError, ValueError) as error:
            explained = await _done(self._thread.submit(self.rig._explained, error))
            if explained is error:
                raise
            raise explained from error

    async def _ask(self, request: str) -> Dict[str, Any]:
        path = str(self.rig.dir / "control")
        reader, writer = await asyncio.open_unix_connection(path, limit=ANSWER_MAX)
        try:
            writer.write(request.encode())
            return answered(await reader.readline())
        finally:
            writer.close()


@asynccontextmanager
async def _started(start: Callable[[], Session]) -> AsyncIterator[AsyncRig]:
    # A thread of its own: the default ones are few, and may all be busy.
    thread = ThreadPoolExecutor(1, "hilrig")
    starting = thread.submit(start)
    try:
        rig = await _done(starting)
        yield AsyncRig(rig, thread)
    finally:
        closing = thread.submit(_close, starting)
        thread.shutdown(wait=False)
        await _done(closing)


def _close(starting: "Future[Session]") -> None:
    """Closes the rig, also if its start was cancelled."""
    if starting.exception() is None:
        starting.result().close()


async def _done(future: "Future[_Value]") -> _Value:
    """The result of a future, whose thread goes on after a cancellation."""
    return await asyncio.shield(asyncio.wrap_future(future))


def rig(scenario: PathLike, **settings: Any) -> Any:
    """``Rig`` for an ``async with`` block."""
    return _started(functools.partial(Rig, scenario, **settings))


def start(scenario: PathLike, program: str, **settings: Any) -> Any:
    """``Running`` for an ``async with`` block."""
    return _started(functools.partial(Running, scenario, program, **settings))


def device(description: PathLike = "", **settings: Any) -> Any:
    """``Bench`` for an ``async with`` block."""
    return _started(functools.partial(Bench, description, **settings))
