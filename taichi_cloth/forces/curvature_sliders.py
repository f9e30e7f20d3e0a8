"""Stiffness and reach of the sliders of bending by curvatures, from a fabric: see `curvature_hysteresis`. numpy only."""

from dataclasses import dataclass
from dataclasses import fields as fields_of

import numpy as np

from ..scene.fabric import Bend, pair
from ..scene.mesh import TriMesh
from .hinge import COLLAPSED
from .hysteresis import SLIP


@dataclass(frozen=True)
class CurvatureSliders:
    """Constants of the sliders of m triangles, with friction first and creases behind it.

    Attributes:
        k: (m, 2, 3) stiffness for x_uu, x_uv, x_vv [N m^3]; reach: (m, 2) d [1/m]; mean: (m, 2) K [N m^3].
        recovery: (m, 2) rate [1/s] at which creases go back while they are pulled back, and curvature [1/m] that stays.
        floor: (m,) doubled area [m^2] below which a triangle fades.
    """

    k: np.ndarray
    reach: np.ndarray
    mean: np.ndarray
    recovery: np.ndarray
    floor: np.ndarray


def own_part(bend: Bend) -> float:
    """Part of the rigidity that the spring keeps which does not yield."""
    return 1.0 if bend.yield_ is None else bend.hardening


def sliders(bend: Bend, mesh: TriMesh) -> CurvatureSliders:
    """Constants of the sliders of a cloth that bends by curvatures."""
    area, m = mesh.material_areas, mesh.face_count
    u, v = pair(bend.friction)
    rubs, gives = (u + v) / 2, (1 - own_part(bend)) * np.sqrt(np.prod(pair(bend.D)))
    moduli = np.array([moduli_of((u * u, v * v)), moduli_of(bend.D)])
    moduli *= np.array([[1 / (SLIP * rubs) if rubs else 0.0], [1 - own_part(bend)]])
    reach = [SLIP, 0.0 if bend.yield_ is None else bend.yield_]
    of_all = np.ones(m)[:, None]
    return CurvatureSliders(area[:, None, None] * moduli, of_all * reach, area[:, None] * [rubs / SLIP, gives],
                        of_all * pair(bend.recovery), 2 * COLLAPSED * area)


def joined(parts: list[CurvatureSliders]) -> CurvatureSliders:
    """Those of all cloths."""
    return CurvatureSliders(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields_of(CurvatureSliders)))


def moduli_of(value) -> list[float]:
    """Moduli of the terms |x_uu|^2, |x_uv|^2, |x_vv|^2, from (warp, weft)."""
    u, v = pair(value)
    return [u, 2 * np.sqrt(u * v), v]
