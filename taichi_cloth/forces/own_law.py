"""The part that laws of a user's own share: the cloths that they are on, and their numbers. numpy only."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from .. import checks
from ..errors import SceneError
from ..scene.cloth import Cloth
from ..scene.scene import Scene

Rows = tuple[tuple[Cloth, np.ndarray], ...]  # cloths, each with (faces, parameters)


class OwnLaw(ABC):
    """A law on the cloths that `on` names, with parameters of theirs.

    Attributes:
        parameters: names of the law's numbers, in the order in which `k` has them.
        damped: unit of k_d, and how many of them there are.
    """

    parameters: tuple[str, ...] = ()
    damped: tuple[str, int] = ("N s/m", 3)

    @classmethod
    def on(cls, *cloths: Cloth, k_d: float | Sequence[float] = 0.0, **values: Any) -> Callable:
        """The law on these cloths, for `Scene.add_force`.

        Args:
            k_d: damping; of membranes [N s/m] one number, or three for the stretch of warp and weft and for shear; of bending
                [N m s].
            values: the parameters by name, each a number or, of one cloth, (faces,).

        Raises:
            SceneError: a parameter that is missing, unknown or not finite; a law that lacks a part.
        """
        what, lacks = cls.__name__, sorted(getattr(cls, "__abstractmethods__", ()))
        if lacks:
            raise SceneError(f"{what}: the law lacks {', '.join(lacks)}")
        if not cloths:
            raise SceneError(f"{what}: on which cloth? {what}.on(cloth, ...)")
        for cloth in cloths:
            checks.instance(f"{what}: cloth", cloth, Cloth)
        wanted, given = set(cls.parameters), set(values)
        if wanted != given:
            missing, unknown = sorted(wanted - given), sorted(given - wanted)
            said = [f"{word} {', '.join(names)}" for word, names in (("lacks", missing), ("has no", unknown)) if names]
            raise SceneError(f"{what}: {' and '.join(said)}; its parameters: {', '.join(cls.parameters)}")
        make: Callable = cls
        return partial(make, rows=tuple((cloth, cls._row(cloth, len(cloths), values)) for cloth in cloths),
                       k_d=cls._damping(k_d))

    @classmethod
    def _damping(cls, k_d: object) -> tuple[float, ...]:
        what, (unit, count) = f"{cls.__name__}: k_d", cls.damped
        each = checks.array(what, k_d, (count,)).tolist() if checks.is_sequence(k_d) and count > 1 else [k_d] * count
        return tuple(checks.number(what, d, unit, least=0.0) for d in each)

    @classmethod
    def _row(cls, cloth: Cloth, count: int, values: dict[str, Any]) -> np.ndarray:
        """(faces, parameters)"""
        out = np.empty((cloth.mesh.face_count, len(cls.parameters)))
        for column, name in enumerate(cls.parameters):
            what = f"{cls.__name__}: {name}"
            if count == 1 and np.ndim(values[name]):
                out[:, column] = checks.array(what, values[name], (len(out),), row="face")
            else:
                out[:, column] = checks.number(what, values[name])
        return out

    def _check(self, scene: Scene, rows: Rows) -> None:
        """Refuses a law without cloths, or on those of another scene."""
        what = type(self).__name__
        if not rows:
            raise SceneError(f"{what}: on which cloth? scene.add_force({what}.on(cloth, ...))")
        for cloth, _ in rows:
            if not any(cloth is other for other in scene.cloths):
                raise SceneError(f"{what}: {cloth.name!r} is not a cloth of this scene; pass the one that its add_cloth "
                                 "returned")

    @abstractmethod
    def stiffest(self, *values: np.ndarray) -> Any:
        """The largest second derivative of the energy per area at rest, in numpy: it decides the length of explicit steps.

        Args:
            values: the parameters, (k,) each.

        Returns:
            (k,) for a membrane that of psi along any F of size 1 [N/m], for bending that by curvature [N m].
        """

    def _stiffest(self, numbers: np.ndarray) -> np.ndarray:
        """(k,) `stiffest` of rows of numbers, checked."""
        stiff = np.broadcast_to(np.asarray(self.stiffest(*numbers.T), dtype=float), (len(numbers),))
        if not (np.isfinite(stiff).all() and (stiff > 0).all()):
            raise SceneError(f"{type(self).__name__}: stiffest() must be positive and finite; with these parameters it is not")
        return stiff


def vectors(numbers: np.ndarray) -> np.ndarray:
    """(m, k) numbers with k at least 2: a field of rows of one number has no vectors."""
    return np.pad(numbers, ((0, 0), (0, max(0, 2 - numbers.shape[1]))))
