"""Orders of a page to a session: from the threads of the page to the one thread that simulates."""

from __future__ import annotations

import threading
from collections.abc import Callable


def named(order: str, values: tuple) -> str:
    """A change in words, such as "fabric: silk"; "" of an order that changes nothing of the scene."""
    if order == "set":
        return f"{values[0]}: {values[1]:.6g}" if isinstance(values[1], float) else f"{values[0]}: {values[1]}"
    return f"wind added: {', '.join(f'{v:.3g}' for v in values[0])} m/s" if order == "blow" else ""


class Orders:
    """Calls that wait to be made, in order. Only the last call with a key is made, such as that of a slider or a mouse."""

    def __init__(self) -> None:
        self._ready = threading.Condition()
        self._waiting: list[tuple[str, Callable[[], object]]] = []

    def put(self, call: Callable[[], object], key: str = "") -> None:
        """One more, in place of an earlier one with its key."""
        with self._ready:
            if key:
                self._waiting = [one for one in self._waiting if one[0] != key]
            self._waiting.append((key, call))
            self._ready.notify_all()

    def take(self, wait: float | None = 0.0) -> list[Callable[[], object]]:
        """All that wait, and none are left; if there are none, waits for the first for so long [s], or for ever."""
        with self._ready:
            self._ready.wait_for(lambda: self._waiting, wait)
            out, self._waiting = [call for _, call in self._waiting], []
        return out
