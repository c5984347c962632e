"""The API server's objects of one kind, kept up to date in a thread."""

from __future__ import annotations

import json
import threading
import urllib.request
from collections.abc import Callable, Iterable, Mapping
from http.client import HTTPException
from typing import Any
from urllib.parse import urlencode

from robot_offload_lab.cluster.control_plane import ControlPlane

Object = Mapping[str, Any]
_ROUND = 300  # seconds after which a watch is renewed
_PAUSE = 0.3  # seconds until the next attempt when the API server is away


class ObjectWatch(threading.Thread):
    """Lists the objects of a path, then follows their changes; starts over after any error."""

    def __init__(self, plane: ControlPlane, path: str, changed: Callable[[], None]) -> None:
        super().__init__(name=f"watch {path}", daemon=True)
        self._plane, self._path, self._changed = plane, path, changed
        self._objects: dict[str, Object] | None = None
        self._lock = threading.Lock()

    def objects(self) -> list[Object] | None:
        """Return all known objects; None until they have been listed once."""
        with self._lock:
            return None if self._objects is None else list(self._objects.values())

    def run(self) -> None:
        """Follow until the process ends."""
        while True:
            try:
                version = self._list()
                self._changed()
                for event in self._events(version):
                    self._apply(event)
                    self._changed()
            except (OSError, ValueError, HTTPException):  # the API server is away, or has forgotten our version
                threading.Event().wait(_PAUSE)

    def _list(self) -> str:
        answer = json.loads(self._plane.get(self._path))
        with self._lock:
            self._objects = {each["metadata"]["uid"]: each for each in answer["items"]}
        return str(answer["metadata"]["resourceVersion"])

    def _events(self, version: str) -> Iterable[Object]:
        question = urlencode({"watch": "1", "resourceVersion": version, "timeoutSeconds": _ROUND})
        request = urllib.request.Request(
            f"{self._plane.url}{self._path}?{question}", headers={"Authorization": f"Bearer {self._plane.token}"}
        )
        with self._plane.opener().open(request, timeout=_ROUND + 30) as lines:
            for line in lines:
                yield json.loads(line)

    def _apply(self, event: Object) -> None:
        if event["type"] == "ERROR":
            raise ValueError(event["object"])
        thing = event["object"]
        with self._lock:
            assert self._objects is not None
            if event["type"] == "DELETED":
                self._objects.pop(thing["metadata"]["uid"], None)
            else:
                self._objects[thing["metadata"]["uid"]] = thing
