"""The control socket of a running rig: one JSON object per line in each way (docs/control.md)."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any, Dict, Mapping, Union

#: Version of the protocol that this client supports.
PROTOCOL = 1
#: The error of a request to a rig that has ended.
ENDED = "the rig has ended"


class Refused(ValueError):
    """The rig refused a request; it names the key and the expected value. Nothing has changed."""

    def __init__(self, key: str, message: str) -> None:
        super().__init__(f"{key}: {message}")
        self.key = key
        self.message = message


def has_ended(error: Exception) -> bool:
    """Whether ``error`` of a request says that the rig has ended."""
    return isinstance(error, OSError) or (isinstance(error, Refused) and error.key == "run")


def encoded(do: str, keys: Mapping[str, Any]) -> str:
    """A request as its line."""
    return json.dumps({"do": do, **keys}) + "\n"


def answered(line: "str | bytes") -> Dict[str, Any]:
    """The answer in a line; an empty one is the end of the connection."""
    if not line:
        raise ConnectionError(ENDED)
    answer: Dict[str, Any] = json.loads(line)
    if not answer.get("ok"):
        raise Refused(str(answer.get("key")), str(answer.get("message")))
    return answer


class Control:
    """A connection to a running rig."""

    def __init__(self, directory: Union[str, Path]) -> None:
        """Connects to the rig with its ports in ``directory``."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(str(Path(directory) / "control"))
        except OSError:
            self._socket.close()
            raise
        self._file = self._socket.makefile("rw", encoding="utf-8", newline="\n")
        try:
            self.greeting = self.ask("hello")
        except BaseException:
            self.close()
            raise
        if self.greeting["protocol"] != PROTOCOL:
            spoken = self.greeting["protocol"]
            self.close()
            raise ConnectionError(f"the rig speaks protocol {spoken}, expected {PROTOCOL}")

    def ask(self, do: str, **keys: Any) -> Dict[str, Any]:
        """Sends a request and returns its answer; raises ``Refused`` if the rig refuses it."""
        if self._file.closed:
            raise ConnectionError(ENDED)
        try:
            self._file.write(encoded(do, keys))
            self._file.flush()
            line = self._file.readline()
        except ConnectionError as error:
            raise ConnectionError(ENDED) from error
        return answered(line)

    def close(self) -> None:
        """Disconnects; the rig continues."""
        for end in (self._file, self._socket):
            try:
                end.close()
            except OSError:
                pass  # Unsent bytes are lost.
