"""The control socket of a running rig: one JSON object per line in each way (docs/control.md)."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any, Dict, Union

#: Version of the protocol that this client supports.
PROTOCOL = 1


class Refused(ValueError):
    """The rig refused a request; it names the key and the expected value. Nothing has changed."""

    def __init__(self, key: str, message: str) -> None:
        super().__init__(f"{key}: {message}")
        self.key = key
        self.message = message


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
        self.greeting = self.ask("hello")
        if self.greeting["protocol"] != PROTOCOL:
            spoken = self.greeting["protocol"]
            self.close()
            raise ConnectionError(f"the rig speaks protocol {spoken}, expected {PROTOCOL}")

    def ask(self, do: str, **keys: Any) -> Dict[str, Any]:
        """Sends a request and returns its answer; raises ``Refused`` if the rig refuses it."""
        request = {"do": do, **keys}
        self._file.write(json.dumps(request) + "\n")
        self._file.flush()
        line = self._file.readline()
        if not line:
            raise ConnectionError("the rig has ended")
        answer: Dict[str, Any] = json.loads(line)
        if not answer.get("ok"):
            raise Refused(str(answer.get("key")), str(answer.get("message")))
        return answer

    def close(self) -> None:
        """Disconnects; the rig continues."""
        for end in (self._file, self._socket):
            try:
                end.close()
            except OSError:
                pass  # Unsent bytes are lost.
