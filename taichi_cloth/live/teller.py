"""Sends pictures of a session to its page, as fast as the page shows them: the session never waits for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from ..output.camera import ground_height
from ..output.described import view_of
from ..output.facing import facing
from ..output.framing import fit_all
from ..output.look import Heat
from ..recording.expected import expected
from ..scene.view import camera_at
from .seen import Building, Opening, Scale, Seen
from .session import Session
from .shapes import Arrays, Shapes, bar, points
from .words import costly, last_step, state

ASPECT = 1.3  # of a window, about, beside its controls
WORTH = 1.0  # s of building kernels that a line is worth
WORDS = 0.5  # s from one reading of the log to the next


class Teller:
    """A session's `show`.

    Args:
        title: of the page.
        send: hands an `Opening`, then each `Seen` and `Building`, to the page.
        tells: is called with lines for the console.
    """

    def __init__(self, title: str, send: Callable[[Opening | Seen | Building], object],
                 tells: Callable[[str], object] = lambda line: None) -> None:
        self.title, self.send, self.tells = title, send, tells
        self._lock = threading.Lock()
        self._busy = self._late = False  # the page is still drawing the last picture; a newer one waits
        self._geometry: Arrays | None = None
        self._number, self._worded = 0, 0.0
        self._told: object = None  # the pieces that the page has
        self._building: float | None = None  # since when, as the page knows

    def __call__(self, session: Session) -> None:
        """Tells of the session now, or later where the page is still busy."""
        if self._geometry is None:
            self.send(opening(session, self.title))
        if not session.preview:
            self._built()  # also where the page is busy
        with self._lock:
            if self._busy and not session.preview:  # a preview is all that is to be seen for a while
                self._late = True
                return
            self._busy, self._late = True, False
        if session.geometry is not self._geometry:
            self._geometry, self.shapes = session.geometry, Shapes(session.geometry)
            self._number, self._told = self._number + 1, None
        self.send(self._seen(session))

    def building(self) -> None:
        """Tells that kernels are built before the next picture."""
        if self._building is None:
            self._building = time.monotonic()
            self.send(Building())

    def _built(self) -> None:
        """Tells how long that took."""
        if self._building is not None and (took := time.monotonic() - self._building) > WORTH:
            self.tells(f"loading or compiling kernels took {took:.0f} s")
        self._building = None

    def shown(self, session: Session) -> None:
        """The page has shown the last picture; may be called from any thread."""
        with self._lock:
            self._busy, late = False, self._late
        if late:
            session.ask("look", key="look")

    def _seen(self, session: Session) -> Seen:
        heat = _heat(session)
        pieces = self.shapes.pieces(session.geometry, session.arrays, heat)
        fresh, self._told = pieces is not self._told, pieces
        scale = None
        if heat is not None:
            scale = Scale(bar(heat), f"{heat.range[0]:.3g} to {heat.range[1]:.3g} {heat.unit}".strip())
        hand = None if session.hand is None else np.array([session.hand.held_at(), session.hand.place], dtype=np.float32)
        heats = None if session.preview else tuple(session.heats())
        now, words = time.monotonic(), (None, None)
        if session.sim is not None and (not session.running or now - self._worded > WORDS):
            self._worded = now
            words = last_step(session.sim.last) if session.sim.last else "", costly(session)  # type: ignore[assignment]
        return Seen(self._number, points(session.geometry, session.arrays), pieces if fresh else None, state(session),
                    session.running, session.preview, session.changes, session.change, heats,
                    scale, hand, *words)


def _heat(session: Session) -> Heat | None:
    """The heat map that colours the cloth, or None."""
    if not session.heat or session.preview:
        return None
    from ..recording.playback import heat_of  # imports Taichi, before which a scene is shown as it was built

    return heat_of(session.heat, session.geometry)


def opening(session: Session, title: str) -> Opening:
    """The `Opening` of a page of the session."""
    geometry = session.geometry
    x = np.concatenate([geometry["x"], geometry["solid_x"]])
    view, to_come = view_of(geometry), list(expected(session.scene, 0.0))
    reached = [frame["x"] for frame in to_come]
    camera = (camera_at(view.camera, 0.0) if view.camera is not None else
              fit_all([x, *reached], view.reach, ASPECT, facing(to_come, geometry["faces"])))
    middle = (x.min(axis=0) + x.max(axis=0)) / 2
    cloth, solid = (min(float(part[:, 1].min(initial=np.inf)) for part in parts)
                    for parts in (reached, [geometry["solid_x"]]))
    middle[1] = ground_height(x, view, cloth - view.reach, solid)
    return Opening(title, session.source.parameters, session.source.again, session.scene.air is not None, tuple(camera.eye),
                   tuple(camera.target), tuple(camera.up), camera.fov, tuple(middle.tolist()),
                   float(np.linalg.norm(np.ptp(x, axis=0))))
