"""VTK and VTU by meshio, after the sizes that the file claims were held against its own."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np

from .polygon import triangles_of

# the numbers that follow: rows, or rows and numbers in all
CLAIMS = re.compile(rb"^\s*(POINTS|CELLS|CELL_TYPES|POLYGONS|POINT_DATA|CELL_DATA|DIMENSIONS)((?:[ \t]+[-+]?\d+)+)", re.M)
CLAIMS_XML = re.compile(rb"(NumberOf\w+|NumberOfComponents)\s*=\s*[\"']([^\"']*)[\"']")
DEFLATED = 1100  # times that zlib can make data smaller, at the very most


def read_vtk(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and triangles (m, 3).

    Raises:
        ValueError: names the fault of the file.
    """
    import meshio

    data = path.read_bytes()
    xml = path.suffix.lower() == ".vtu"
    for claim in (CLAIMS_XML if xml else CLAIMS).finditer(data):
        for number in claim[2].split():
            if not re.fullmatch(rb"\+?\d{1,18}", number) or int(number) > len(data) * (DEFLATED if xml else 1):
                what = f"{claim[1].decode()} {number.decode('ascii', 'replace')}"
                raise ValueError(f"says {what}, and is {len(data)} bytes long")
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            mesh = meshio.read(path)
    except SystemExit:  # meshio's way of giving up, after it has printed why
        raise ValueError(" ".join(said.getvalue().split())[:200] or "meshio gives no reason") from None
    except Exception as error:
        raise ValueError(f"{type(error).__name__}: {error}"[:200]) from None
    x = np.asarray(mesh.points, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] not in (2, 3):
        raise ValueError(f"has positions of shape {x.shape}")
    x = np.column_stack([x, np.zeros((len(x), 3 - x.shape[1]))])
    blocks = [triangles_of(x, np.asarray(c.data)) for c in mesh.cells if c.type in ("triangle", "quad", "polygon")]
    if not blocks:
        raise ValueError("the mesh has no faces")
    return x, np.concatenate(blocks)
