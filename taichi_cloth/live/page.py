"""The page of a session: its cloth, its buttons and sliders, by viser. Only what is on the page is known here."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..output.camera import ground_height
from ..output.described import view_of
from ..output.framing import fit_all
from ..recording.playback import heat_of
from ..scene.view import camera_at
from .controls import Controls
from .session import Session
from .shapes import Arrays, Piece, Shapes, bar, points
from .words import costly, last_step, state

ASPECT = 1.3  # of a window, about, beside its controls
WORDS = 0.5  # s from one reading of the log to the next
TILES = 40  # of the ground, along a side
THREAD = (255, 140, 0)  # sRGB


class Page:
    """Shows a session and puts what is clicked, turned and dragged into its orders.

    Args:
        server: of viser's; title: over the controls.
    """

    def __init__(self, server: Any, title: str) -> None:
        self.server, self.title = server, title
        self.meshes: dict[str, Any] = {}
        self.controls: Controls | None = None
        self._session: Session | None = None
        self._geometry: Arrays | None = None
        self.thread: Any = None
        self._worded = 0.0
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.gui.set_panel_label(title)
        server.scene.set_up_direction("+y")

    def show(self, session: Session) -> None:
        """What the session has to be seen."""
        if self.controls is None:
            self._session = session
            self.controls = Controls(self.server.gui, session)
            self._place(session.geometry)
        if session.geometry is not self._geometry:
            for mesh in self.meshes.values():
                mesh.remove()
            self.meshes.clear()
            self._geometry, self.shapes = session.geometry, Shapes(session.geometry)
            if not session.preview:
                self.controls.offer(session.heats())
        heat = heat_of(session.heat, session.geometry) if session.heat and not session.preview else None
        with self.server.atomic():
            self._draw(session, self.shapes.pieces(session.geometry, session.arrays, heat))
            self._hand(session)
            self.controls.say(state(session), session.running)
        self.controls.scale(heat, None if heat is None else bar(heat))
        now = time.monotonic()
        if session.sim is not None and (not session.running or now - self._worded > WORDS):
            self._worded = now
            self.controls.tell(last_step(session.sim.last) if session.sim.last else "", costly(session))

    def _draw(self, session: Session, pieces: dict[str, Piece]) -> None:
        """Meshes are changed in place, and hidden where they have no triangles: one that goes ends a drag of it."""
        x = points(session.geometry, session.arrays)
        wire = self.controls.wire.value  # type: ignore[union-attr]
        for name, mesh in self.meshes.items():
            mesh.visible = name in pieces
        for name, piece in pieces.items():
            if name in self.meshes:
                mesh = self.meshes[name]
                mesh.vertices, mesh.faces = x[piece.index], piece.faces.astype(np.uint32)
            else:
                mesh = self.server.scene.add_mesh_simple(f"/{name}", x[piece.index], piece.faces, color=piece.color,
                                                         side="double")
                if piece.cloth:
                    mesh.on_drag(self._dragged)
                self.meshes[name] = mesh
            mesh.wireframe = wire and piece.cloth

    async def _dragged(self, event: Any) -> None:
        """In the server's own thread, where events keep their order."""
        session = self._session
        assert session is not None
        start, end = np.array(event.start_position), np.array(event.end_position)
        if event.phase == "start":
            session.orders.put(lambda: session.grab(start))
        session.orders.put(lambda: session.drag(end), "drag")
        if event.phase == "end":
            session.orders.put(session.drop)

    def _hand(self, session: Session) -> None:
        """A thread from the cloth to the hand, while it pulls."""
        if session.hand is not None:
            ends = np.array([[session.hand.held_at(), session.hand.place]], dtype=np.float32)
            if self.thread is None:
                self.thread = self.server.scene.add_line_segments("/hand", ends, THREAD, thickness=3.0,
                                                                  thickness_units="screen")
            self.thread.points = ends
        if self.thread is not None:
            self.thread.visible = session.hand is not None

    def _place(self, geometry: Arrays) -> None:
        """The camera and the ground."""
        x = np.concatenate([geometry["x"], geometry["solid_x"]])
        view, camera = view_of(geometry), self.server.initial_camera
        seen = fit_all([x], view.reach, ASPECT) if view.camera is None else camera_at(view.camera, 0.0)
        camera.position, camera.look_at, camera.up = seen.eye, seen.target, seen.up
        camera.fov = float(np.radians(seen.fov))
        size = float(np.linalg.norm(np.ptp(x, axis=0)))
        camera.near, camera.far = 1e-3 * size, 1e3 * size
        middle = (x.min(axis=0) + x.max(axis=0)) / 2
        tile = 10.0 ** np.floor(np.log10(size)) / 2
        self.server.scene.add_grid("/ground", TILES * tile, TILES * tile, plane="xz", cell_size=tile, section_size=2 * tile,
                                   position=(middle[0], ground_height(x, view), middle[2]))
