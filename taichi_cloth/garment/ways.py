"""Ways out for a body that no shipped pattern fits by itself: those that are open for this body. numpy only."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import SceneError
from ..scene.scene import Scene
from ..scene.solids import SolidMesh
from .figure import surface_of

MANY = 30  # parts of a body: more are not left out in turn, which would take longer than the user waits


def ways(body: Scene, parts: Sequence[str], measure: Callable[[np.ndarray, np.ndarray], object], wide: float | None) -> str:
    """Ends a sentence on a body that cannot be measured, or is no person's.

    Args:
        parts: of the body's file, groups of the one solid that it is.
        measure: of vertices (n, 3) [m] and triangles (m, 3); it raises a SceneError where they are no person's.
        wide: times as wide as the figure that patterns are drawn for; None where that is not known.
    """
    shapes = [s.shape for s in body.solids if isinstance(s.shape, SolidMesh)]
    names = [name for name in parts if len(body.solids) == len(shapes) == 1 and name in shapes[0].groups]
    said = []
    if 1 < len(names) <= MANY and (found := _parts(shapes[0], surface_of(body), names, measure)):
        return f"read the parts of it that are a person: {' '.join(f'--only {name!r}' for name in found)}"
    if len(names) > 1:
        said.append(f"read those of its {len(names)} parts that are trunk, legs and head, without arms and things that it "
                    "carries (--only PART; `look` lists them)")
    size = "" if wide is None else f"--scale {1 / wide:.3g} times that of its file makes it as wide as patterns are, "
    said.append(f"leave out --fit and bring the pattern there by hand ({size}--turn, --shift; Garment.placed)")
    return f"patterns are shipped for people who stand: {', or '.join(said)}, or draw panels round it"


def _parts(shape: SolidMesh, whole: tuple[np.ndarray, np.ndarray], names: list[str], measure: Callable) -> Sequence[str]:
    """One part that is a person by itself, or all but one that together are; none if there is no such choice."""
    x, faces = whole
    inside = {name: np.isin(faces, shape.groups[name]).all(axis=1) for name in names}
    for chosen in [*([name] for name in names), *([n for n in names if n != name] for name in names)]:
        rows = faces[np.any([inside[name] for name in chosen], axis=0)]
        if not 0 < len(rows) < len(faces):
            continue
        try:
            used, local = np.unique(rows, return_inverse=True)
            measure(x[used], local.reshape(-1, 3))
        except SceneError:
            continue
        return chosen
    return []
