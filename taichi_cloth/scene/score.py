"""Lines along which cloth that may tear is weaker. numpy only."""

from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError
from .cloth import Cloth
from .crease import along


@dataclass(frozen=True, eq=False)
class Score:
    """A scored line; made by `Scene.score`.

    Attributes:
        edges: (k, 2) vertices, the lower first.
        fraction: of the strength that is left there.
    """

    cloth: Cloth
    edges: np.ndarray
    fraction: float

    def __repr__(self) -> str:
        return f"<Score of {self.cloth.name!r} over {len(self.edges):,} edges, {self.fraction:g} of the strength left>"


def score(cloth: Cloth, line: object, fraction: object) -> Score:
    """The score of `Scene.score`."""
    what = f"score of {cloth.name!r}"
    if cloth.split is None:
        raise SceneError(f"{what}: it does not tear: add it with tear=Tear(strength)")
    left = checks.number(f"{what}: fraction", fraction, least=0.0, most=1.0)
    edges = along(what, cloth.whole, cloth.whole.inner_edges, line)
    if not cloth.split.on_line(edges).any():
        raise SceneError(f"{what}: nothing on the line is where the cloth may tear")
    return Score(cloth, edges, left)
