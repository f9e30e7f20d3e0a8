"""A garment: panels as one mesh, and the rows of vertices that are sewn to each other. numpy only."""

import os
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import checks
from ..errors import SceneError
from .mesh import TriMesh

Row = tuple[np.ndarray, np.ndarray, float | str]


@dataclass(frozen=True, eq=False)
class Garment:
    """What `Scene.add_garment` takes.

    Attributes:
        mesh: all panels, as they hang round the body; groups by the names of panels and of labels of edges.
        seams: (a, b, rest): rows of vertices that are sewn to each other, and the seam's angle, as in `Scene.sew`.
        positions: (n, 3) where a dressed garment is [m]; the mesh's own where it was not dressed.
    """

    mesh: TriMesh
    seams: tuple[Row, ...]
    positions: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        checks.instance("garment: mesh", self.mesh, TriMesh)
        n = self.mesh.vertex_count
        x = self.mesh.x if self.positions is None else self.positions
        object.__setattr__(self, "positions", checks.array("garment: positions", x, (n, 3), row="vertex"))

    def gap(self) -> float:
        """Largest distance [m] between vertices that are sewn to each other."""
        x = self.positions
        return max((float(np.linalg.norm(x[a] - x[b], axis=1).max()) for a, b, _ in self.seams), default=0.0)

    def save(self, path: str | Path) -> None:
        """Writes a .npz that `load_garment` reads.

        Raises:
            SceneError: it cannot be written; what was there before stays.
        """
        path = checks.path("path", path, SceneError)
        mesh, part = self.mesh, path.with_name(path.name + ".part")
        arrays = {"x": mesh.x, "faces": mesh.faces, "corner_uv": mesh.corner_uv, "positions": self.positions,
                  **{f"group_{name}": index for name, index in mesh.groups.items()},
                  **{f"seam_{k}": np.stack([a, b]) for k, (a, b, _) in enumerate(self.seams)},
                  "rest": np.array([str(rest) for _, _, rest in self.seams])}
        try:
            with open(part, "wb") as file:
                np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
            os.replace(part, path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None


def load_garment(path: str | Path) -> Garment:
    """A garment that `Garment.save` wrote.

    Raises:
        SceneError: a file that is missing, damaged or no garment.
    """
    path = checks.path("path", path, SceneError)
    try:
        with np.load(path, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
        groups = {name[6:]: index for name, index in data.items() if name.startswith("group_")}
        mesh = TriMesh(data["x"], data["faces"], data["corner_uv"], groups)
        seams = tuple((*data[f"seam_{k}"], _angle(str(rest))) for k, rest in enumerate(data["rest"]))
        return Garment(mesh, seams, data["positions"])  # type: ignore[arg-type]
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, ValueError, EOFError, TypeError, zipfile.BadZipFile, MemoryError, NotImplementedError) as error:
        raise SceneError(f"{path}: is no garment: {type(error).__name__}: {error}") from None


def _angle(text: str) -> float | str:
    return text if text in ("flat", "given") else float(text)
