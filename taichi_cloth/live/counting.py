"""Seconds that count beside a sentence, in a thread of their own: the simulation's process stands still meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

EVERY = 0.25  # s from one text to the next


class Counting:
    """Shows a sentence with the seconds since it began, again and again, until another is shown.

    Args:
        show: takes the text; it is called from several threads, by one at a time.
    """

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show, self._lock = show, threading.Lock()
        self._over = threading.Event()

    def count(self, sentence: str, patience: float = 0.0) -> None:
        """Counts from now on; the first text comes after so long [s]."""
        self._over.set()
        self._over = threading.Event()
        threading.Thread(target=self._go_on, args=(sentence, patience, self._over), daemon=True).start()

    def show(self, text: str) -> None:
        """Ends the counting, and shows this."""
        with self._lock:
            self._over.set()
            self._show(text)

    def _go_on(self, sentence: str, patience: float, over: threading.Event) -> None:
        began, wait = time.monotonic(), patience
        while not over.wait(wait):
            with self._lock:
                if not over.is_set():
                    self._show(f"{sentence}, {time.monotonic() - began:.0f} s")
            wait = EVERY
