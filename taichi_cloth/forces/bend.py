"""Bending over hinges: psi = k/2 C^2 with C = theta - theta_0 and k = D |e|^2 / (A_1 + A_2), so that the torque is k C.

Friction between fibres and creases are in `hysteresis`; the loops over hinges are in `hinge_law`.

Differs from [BW98 §4.2]: k scales with the mesh so that D is a plate rigidity. C levels off where a fold closes on
itself, and fades with triangles that collapse: see `hinge`.
"""

from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from ..scene.fabric import remembers
from ..scene.scene import Scene
from ..system.elements import hinges_of, seam_hinges
from ..system.state import ParticleState
from .hinge_law import HingeLaw
from .hinge_rest import creased, rest_of, seam_rest


@ti.data_oriented
class Bend(HingeLaw):
    """Hinges of fabrics and of seams, with damping, friction and creases."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self.exact, self.damps = model, mode == "paper", scene.damped
        bent = [c for c in scene.cloths if any(f.bend and f.bend.model == "hinge" for f in c.fabrics)]
        names = {c.name for c in bent}
        seams = [(s, seam_hinges(s.cloth.mesh, s.a, s.b)) for s in scene.seams if s.cloth.name in names and s.stiffness > 0]
        parts = [(c, hinges_of(c)) for c in bent] + [(s.cloth, h) for s, h in seams]
        sewn: list[Any] = [*bent, *(s for s, _ in seams)]
        vertices = np.concatenate([model.particle[h.vertices + c.start] for c, h in parts])
        rest = np.concatenate([creased(scene, c, h, rest_of(c, h)) for c, h in parts[:len(bent)]]
                              + [seam_rest(s, h) for s, h in seams])
        self.host_rest = stiff = rest
        law = None
        if any(remembers(f.bend) for c in bent for f in c.fabrics if f.bend):
            from .hysteresis import Hysteresis, joined, sliders

            first = np.cumsum([0] + [len(h.vertices) for _, h in parts])
            law = joined([sliders(c, h, rest[a:b], k >= len(bent)) for k, ((c, h), a, b) in enumerate(zip(
                parts, first[:-1], first[1:]))])
            stiff = np.column_stack([law.own * rest[:, 0] + law.k.sum(axis=1), rest[:, 1:]])  # before sliders give
            rest = np.column_stack([law.own * rest[:, 0], rest[:, 1:]])
        self._begin(fields, [h for _, h in parts], vertices, rest, stiff)
        self.has_extra_torque = self.has_crease_side = law is not None
        self.time_dependent = law is not None  # explicit steps must be as short as its changes
        self.hysteresis: Any = None
        if law is not None:
            self.hysteresis = Hysteresis(fields, model, self.elements, law)
        self.yields, self.creased = bool(self.has_extra_torque and self.hysteresis.yields), bool(scene.creases)
        self.host_arc = np.concatenate([h.areas.sum(axis=1) / np.sqrt(h.length2) for _, h in parts])
        self.host_whole = np.ones(len(rest), dtype=bool)
        self._rest: Any = rest if scene.seams else None
        self._sewn: Any = (scene, [(of, h) for of, (_, h) in zip(sewn, parts)]) if scene.seams else None

    @ti.func
    def way(self, e):
        """-1 if a hinge was creased to the negative side, else 1."""
        return self.hysteresis.way(e)

    @ti.func
    def side(self, e, C):
        """-1 if a hinge at C is one that passed through itself, else 1."""
        return self.hysteresis.side(e, C)

    @ti.func
    def extra_torque(self, e, C):
        """(torque, torque over displacement, slope, energy) of friction and creases, at the condition C."""
        return self.hysteresis.respond(e, C)

    @property
    def follows_steps(self) -> bool:
        """Only with sliders, or in a subclass with an `accept` of its own."""
        return self.has_extra_torque or type(self).accept is not Bend.accept

    def accept(self, h: float) -> bool:
        """Sliders follow the hinges."""
        if self.has_extra_torque:
            self._return_map(h)
        return self.has_extra_torque

    @ti.kernel
    def _return_map(self, h: float):
        for e in range(self.elements.first[self.model.blocks.count]):
            if self.elements.primary[e] == 1:
                self.hysteresis.return_map(e, self.turned(e)[0], h)

    def release(self, whole: np.ndarray, pulled: np.ndarray) -> None:
        """Opens hinges over a seam with either of the stitches at their ends; see `Force`."""
        from ..system.stitches import ends_of

        rest = self._rest.copy()
        held = np.append(whole, True)[ends_of(*self._sewn)]
        self.host_whole = held.all(axis=1)
        rest[:, :2] *= self.host_whole[:, None]
        write(self.rest, self.elements.per_entry(rest).astype(self.model.exchange))

    def geometry(self) -> dict[str, np.ndarray]:
        """Hinges with their stiffness [N m] and rest angle."""
        k, _, theta_0, _ = self.host_rest.T
        out = {"hinges": self.model.user[self.host_hinges], "hinge_k": k, "hinge_rest": theta_0}
        if self.yields or self.creased:
            own = self.hysteresis.own if self.yields else np.ones(len(k))
            out |= {"creases": np.array(True), "hinge_arc": self.host_arc, "hinge_own": own}
        return out

    def recorded(self) -> dict[str, np.ndarray]:
        """(hinges,) angles [rad] by which hinges are creased; (hinges,) whether each is whole, unless all are."""
        out = {"hinge_crease": self.hysteresis.creases().astype(np.float32)} if self.yields else {}
        return out if self.host_whole.all() else out | {"hinge_whole": self.host_whole}
