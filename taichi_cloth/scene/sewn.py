"""Work on cloth before it moves: garments, seams, creases, lines that are scored. numpy only."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, shown
from .appearance import Appearance
from .cloth import Cloth
from .contents import Contents
from .crease import Crease
from .crease import make as make_crease
from .fabric import ClothContact, Fabric
from .garment import Garment
from .score import Score, score
from .sewing import Seam, make_stitches
from .sewing import make as make_seam
from .view import Color


class Sewn(Contents):
    """The part of a `Scene` that makes garments."""

    def add_garment(self, garment: Garment, fabric: Fabric | str, velocities: ArrayLike | None = None, name: str | None = None,
                    color: str | Color | Appearance | None = None, contact: ClothContact | None = None,
                    panels: Mapping[str, Fabric | str] | None = None, pull: float | None = None) -> Cloth:
        """Adds a garment's panels as one piece of cloth, and sews its seams.

        Args:
            fabric, velocities, name, color, contact, panels: as in `add_cloth`; pull: as in `sew`.

        A simulation refuses panels that are apart, to be sewn, and start inside a solid: they would be sewn through it.
        """
        checks.instance("add_garment: garment", garment, Garment)
        cloth = self.add_cloth(garment.mesh, fabric, garment.positions, velocities, name, color, contact, panels)
        for seam in garment.seams:
            self.sew(cloth, *seam, pull=pull)
        if garment.gap() > 0:
            self.hung.append((cloth, garment))
        return cloth

    def sew(self, cloth: Cloth, a: ArrayLike, b: ArrayLike, rest: float | str = "flat", stiffness: float = 1.0,
            strength: float | None = None, pull: float | None = None) -> Seam:
        """Sews two rows of vertices of a cloth to each other, one by one.

        They move as one, exactly; vertices that are apart come together first, at .5 m/s at most. If vertices that follow
        each other are the ends of an edge, in both rows, the two edges have a hinge. Three and more layers are seams
        between two of them each.

        Args:
            a, b: (k,) vertices; where both are the same, as at the tip of a dart, nothing is sewn.
            rest: "flat", "given" (the angle in the cloth's mesh), or the angle of the seam at rest [rad].
            stiffness: factor of its hinges' bending stiffness; with 0 there are none.
            strength: force a length [N/m] at which it rips, stitch by stitch; None never does. Each stitch bears it over
                half the way to the next on either side, from when it is closed.
            pull: force a length [N/m] that draws it together while it is apart; a single stitch has half of the border
                beside it. A stitch that bears more stays apart, see `Simulation.seam_gaps`. None sets no limit to the
                force.

        Raises:
            SceneError: rows of different lengths, a vertex twice in a row, nothing to sew, or a strength that is not
                positive.
        """
        self._own(cloth)
        seam = make_seam(cloth, a, b, rest, stiffness, strength, pull)
        self._refuse_followed("sew")
        self.seams.append(seam)
        return seam

    def stitch(self, cloth: Cloth, a: ArrayLike, b: ArrayLike, force: float | None = None) -> Seam:
        """Sews vertices to each other by stitches that stand alone, as buttons do: without hinges, each for itself.

        Args:
            a, b: vertices, one or (k,).
            force: [N] at which each gives; None never does.

        Raises:
            SceneError: as `sew`.
        """
        self._own(cloth)
        seam = make_stitches(cloth, a, b, force)
        self._refuse_followed("stitch")
        self.seams.append(seam)
        return seam

    def unsew(self, seam: Seam, vertices: object = None) -> None:
        """Opens a seam, or those of its stitches that are at `vertices` of its cloth; in an event, from then on.

        Raises:
            SceneError: a seam of another scene, or no stitch there.
        """
        self._stitch("unsew", seam, vertices, False)

    def resew(self, seam: Seam, vertices: object = None) -> None:
        """Closes a seam that was opened by `unsew` or gave, or its stitches at `vertices` of its cloth; in an event, from then
        on. They come together as `sew` says, and bear as much as before.

        Raises:
            SceneError: a seam of another scene, or no stitch there.
        """
        self._stitch("resew", seam, vertices, True)

    def _stitch(self, what: str, seam: Seam, vertices: object, holds: bool) -> None:
        if not any(seam is s for s in self.seams):
            raise SceneError(f"{what}: not a seam of this scene: {shown(seam)}")
        rows = seam.stitches(vertices, what)
        self._refuse_followed(what, live=True)
        self.script.stitched.append((seam, rows, holds))

    def crease(self, cloth: Cloth, angle: ArrayLike, line: ArrayLike | None = None, edges: ArrayLike | None = None,
               stiffness: float = 1.0) -> Crease:
        """Bends edges of a cloth at rest, as ironed pleats are; later creases take the place of earlier ones.

        Args:
            angle: at rest [rad], -pi to pi, one or (k,) for `edges`; positive where the side that normals point to opens.
            line: (p, 2) points of the pattern [m]; the mesh's edges on the straight ways between them.
            edges: (k, 2) vertices, instead.
            stiffness: factor of the edges' bending stiffness; with 0 they are free to turn.

        Raises:
            SceneError: no edge there, a fabric that does not bend over hinges, or an angle beyond pi.
        """
        self._own(cloth)
        crease = make_crease(cloth, angle, line, edges, stiffness)
        self._refuse_followed("crease")
        self.creases.append(crease)
        return crease

    def score(self, cloth: Cloth, line: ArrayLike, fraction: float) -> Score:
        """Weakens cloth that may tear along a line: it tears there at a fraction of its strength, and at 0 is cut.

        Args:
            line: (p, 2) points of the pattern [m]; the mesh's edges on the straight ways between them.

        Raises:
            SceneError: cloth that does not tear, no edge there, or a fraction beyond 0 to 1.
        """
        self._own(cloth)
        scored = score(cloth, line, fraction)
        self._refuse_followed("score")
        self.scores.append(scored)
        if self.scores[-1].fraction == 0:
            seam = next(s for s in self.seams if s.cloth is cloth and s.tears)
            cut = np.flatnonzero(cloth.split.on_line(self.scores[-1].edges))  # type: ignore[union-attr]
            self.script.stitched.append((seam, cut, False))
        return self.scores[-1]
