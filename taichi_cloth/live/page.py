"""The page of a session: its cloth, its buttons and sliders, by viser. It knows nothing of the simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .controls import BUILDING, SHORT, Controls
from .seen import Opening, Seen

TILES = 40  # of the ground, along a side
SKY, GROUND, AROUND = (255, 255, 255), (120, 115, 110), 2.5  # sRGB; times a lamp of viser's
THREAD = (255, 140, 0)  # sRGB
Ask = Callable[[str, tuple, str], object]  # an order of the session, its values, its key; only the last with a key counts


class Page:
    """Shows each `Seen`, and turns clicks, sliders and drags into orders.

    Args:
        server: of viser's; opened: the part of the page that stays.
    """

    def __init__(self, server: Any, opened: Opening, ask: Ask) -> None:
        self.server, self.ask = server, ask
        self.meshes: dict[str, Any] = {}
        self.thread: Any = None
        self.number, self.pieces = 0, {}  # type: ignore[var-annotated]
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.gui.set_panel_label(opened.title)
        server.scene.set_up_direction("+y")
        self._light()
        self._place(opened)
        self.controls = Controls(server.gui, opened, ask)

    def show(self, seen: Seen) -> None:
        """A picture."""
        if seen.number != self.number:
            for mesh in self.meshes.values():
                mesh.remove()
            self.meshes.clear()
            self.number = seen.number
        if seen.pieces is not None:
            self.pieces = seen.pieces
        with self.server.atomic():
            self._draw(seen.x, fresh=seen.pieces is not None)
            self._pull(seen.hand)
        self.controls.show(seen)

    def building(self) -> None:
        """Says that kernels are built, until the next picture."""
        self.controls.state.count(BUILDING, SHORT)

    def _draw(self, x: np.ndarray, fresh: bool) -> None:
        """Meshes are changed in place, and hidden where they have no triangles: one that goes ends a drag of it."""
        for name, mesh in self.meshes.items():
            mesh.visible = name in self.pieces
        for name, piece in self.pieces.items():
            mesh = self.meshes.get(name)
            if mesh is None:
                mesh = self.server.scene.add_mesh_simple(f"/{name}", x[piece.index], piece.faces, color=piece.color,
                                                         side="double")
                if piece.cloth:
                    mesh.on_drag(self._dragged)
                self.meshes[name] = mesh
            else:
                mesh.vertices = x[piece.index]
                if fresh:
                    mesh.faces = piece.faces.astype(np.uint32)
            mesh.wireframe = self.controls.wire.value and piece.cloth

    async def _dragged(self, event: Any) -> None:
        """In the server's own thread, where events keep their order."""
        if event.phase == "start":
            self.ask("grab", (np.array(event.start_position),), "")
        self.ask("drag", (np.array(event.end_position),), "drag")
        if event.phase == "end":
            self.ask("drop", (), "")

    def _pull(self, hand: np.ndarray | None) -> None:
        """A thread from the cloth to the hand, while it pulls."""
        if hand is not None:
            if self.thread is None:
                self.thread = self.server.scene.add_line_segments("/hand", hand[None], THREAD, thickness=3.0,
                                                                  thickness_units="screen")
            self.thread.points = hand[None]
        if self.thread is not None:
            self.thread.visible = hand is not None

    def _light(self) -> None:
        """Lamps alone: the picture of surroundings that viser lights by takes a browser without a GPU ten seconds."""
        self.server.scene.configure_environment_map(None)
        self.server.scene.add_light_hemisphere("/sky", sky_color=SKY, ground_color=GROUND, intensity=AROUND)

    def _place(self, opened: Opening) -> None:
        """The camera and the ground."""
        camera, size = self.server.initial_camera, opened.size
        camera.position, camera.look_at, camera.up = opened.eye, opened.target, opened.up
        camera.fov = float(np.radians(opened.fov))
        camera.near, camera.far = 1e-3 * size, 1e3 * size
        tile = 10.0 ** np.floor(np.log10(size)) / 2
        self.server.scene.add_grid("/ground", TILES * tile, TILES * tile, plane="xz", cell_size=tile, section_size=2 * tile,
                                   position=opened.middle)
