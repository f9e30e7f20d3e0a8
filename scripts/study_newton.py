"""Newton's method on one backward Euler step of cloth alone, by matrices: how many iterations the balance of forces takes.

    python scripts/study_newton.py            # a table, ten seconds; dense matrices

A sheet of 1 m, held at one side, is given velocities that grow away from it, and noise. A step of 1/60 s is solved from its
start, by matrices of five kinds:

- `product`: damping k_d C_dot dC, its derivative by position left out; stretch without what compression takes off K, shear
  projected: as the operator has it in first solves, in contact and in methods with stages.
- `exact`: the same forces and all of their derivative; not symmetric.
- `energy`: damping as an energy of the step, k_d/(2 h) (C - C_0)^2 with C_0 at its start, and the Hessian of all.
- `projected`: the same, each triangle's Hessian with its negative eigenvalues set to 0.
- `by state`: the Hessian where all of the matrix is positive definite, else projected; halved while the potential grows: as
  further solves of backward Euler without contact have it.

The measure is |f - M (v - v_0)/h| in free directions over the larger of |elastic and damping force| and |weight|.
"""

import argparse

import numpy as np

import taichi_cloth as tc

H, DENSITY, GRAVITY = 1 / 60, 0.2, 9.81
WAYS = ("product", "exact", "energy", "projected", "by state")
SWAP = np.block([[np.zeros((3, 3)), np.eye(3)], [np.eye(3), np.zeros((3, 3))]])  # shear's ddC in (w_u, w_v)
CASES = ((1, 1000, 1), (5, 1000, 1), (5, 5000, 5), (5, 5000, 0), (15, 5000, 5), (15, 20000, 20))  # m/s, k, k_d
MOST, HALVINGS = 25, 10


class Sheet:
    """A sheet of n cells across with stretch k, k_d and shear a tenth of them, and its step."""

    def __init__(self, n: int, speed: float, k: float, k_d: float) -> None:
        mesh, rng = tc.grid(1.0, n), np.random.default_rng(1)
        self.faces, uv, x = mesh.faces, mesh.uv, mesh.x.copy()
        ends = np.stack([uv[self.faces[:, 1]] - uv[self.faces[:, 0]], uv[self.faces[:, 2]] - uv[self.faces[:, 0]]], axis=2)
        inverse, self.area = np.linalg.inv(ends), np.abs(np.linalg.det(ends)) / 2
        self.spread = np.zeros((len(self.faces), 6, 9))  # (w_u, w_v) = spread @ corners (9)
        for way in range(2):
            for c in range(3):
                self.spread[:, 3 * way + c, c] = -inverse[:, :, way].sum(axis=1)
                self.spread[:, 3 * way + c, [3 + c, 6 + c]] = inverse[:, :, way]
        mass = np.zeros(len(x))
        np.add.at(mass, self.faces.ravel(), np.repeat(self.area * DENSITY / 3, 3))
        self.mass, self.rows = np.repeat(mass, 3), (3 * self.faces[:, :, None] + np.arange(3)).reshape(-1, 9)
        self.weight = self.mass * np.tile([0, -GRAVITY, 0], len(x))
        x[:, 1] += 0.02 * np.sin(6 * x[:, 0]) * np.cos(5 * x[:, 2])  # what is exactly flat never buckles
        v = 0.3 * rng.normal(size=x.shape)
        v[:, 1] -= speed * (x[:, 0] - x[:, 0].min())
        held = np.flatnonzero(uv[:, 0] < 1e-9)
        v[held] = 0
        self.free = (3 * np.setdiff1d(np.arange(len(x)), held)[:, None] + np.arange(3)).ravel()
        self.x, self.v, self.k, self.k_d = x.ravel(), v.ravel(), k, k_d
        self.w = self.gradients(self.x)

    def gradients(self, x: np.ndarray) -> np.ndarray:
        """(m, 6) of (w_u, w_v)."""
        return np.einsum("eij,ej->ei", self.spread, x[self.rows])

    def of_triangles(self, w: np.ndarray, way: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Per area: (energy (m,), gradient (m, 6), matrix (m, 6, 6)) by a way.

        Damping counts in the energy, except where it is a force of velocities.
        """
        total, f, matrix = np.zeros(len(w)), np.zeros_like(w), np.zeros((len(w), 6, 6))
        stored, moved = way in WAYS[2:], w - self.w
        for part in (slice(0, 3), slice(3, 6)):
            size, before = np.linalg.norm(w[:, part], axis=1), np.linalg.norm(self.w[:, part], axis=1)
            n = w[:, part] / size[:, None]
            along, across = n[:, :, None] * n[:, None], np.eye(3) - n[:, :, None] * n[:, None]
            rate = (size - before if stored else np.einsum("ei,ei->e", n, moved[:, part])) / H
            pull = self.k * (size - 1)
            f[:, part] += (pull + self.k_d * rate)[:, None] * n
            total += self.k / 2 * (size - 1)**2 + stored * self.k_d / (2 * H) * (size - before)**2
            turned = np.maximum(pull, 0) if way == "product" else pull + self.k_d * rate
            matrix[:, part, part] += (self.k + self.k_d / H) * along + (turned / size)[:, None, None] * across
            if way == "exact":
                matrix[:, part, part] += (self.k_d / H / size)[:, None, None] * n[:, :, None] * np.einsum(
                    "eij,ej->ei", across, moved[:, part])[:, None]
        k, k_d, g = self.k / 10, self.k_d / 10, w @ SWAP
        C, before = (np.einsum("ei,ei->e", q[:, :3], q[:, 3:]) for q in (w, self.w))
        rate = (C - before if stored else np.einsum("ei,ei->e", g, moved)) / H
        f += (k * C + k_d * rate)[:, None] * g
        total += k / 2 * C**2 + stored * k_d / (2 * H) * (C - before)**2
        outer = g[:, :, None] * g[:, None]
        if way == "product":
            matrix += positive(k * outer + (k * C)[:, None, None] * SWAP) + k_d / H * outer
        else:
            matrix += (k + k_d / H) * outer + (k * C + k_d * rate)[:, None, None] * SWAP
        if way == "exact":
            matrix += k_d / H * g[:, :, None] * (moved @ SWAP)[:, None]
        return total, f, matrix

    def whole(self, matrix: np.ndarray) -> np.ndarray:
        """The matrix of the step in free directions, of those of triangles."""
        out = np.diag(self.mass / H**2)
        blocks = np.einsum("eij,eik,ekl->ejl", self.spread, self.area[:, None, None] * matrix, self.spread)
        for rows, block in zip(self.rows, blocks):
            out[np.ix_(rows, rows)] += block
        return out[np.ix_(self.free, self.free)]

    def potential(self, x: np.ndarray) -> float:
        """What a step minimizes [J], with damping as an energy."""
        off = x - self.x - H * self.v
        return float(self.area @ self.of_triangles(self.gradients(x), "energy")[0] + self.mass @ off**2 / (2 * H**2)
                     - self.weight @ x)

    def solve(self, way: str) -> list[float]:
        """The measure before each iteration."""
        x, out = self.x.copy(), []
        for _ in range(MOST):
            _, f, matrix = self.of_triangles(self.gradients(x), way)
            force = np.zeros(len(x))
            np.add.at(force, self.rows, np.einsum("eij,ei->ej", self.spread, self.area[:, None] * f))
            left = self.weight - force - self.mass * ((x - self.x) / H - self.v) / H
            out.append(float(np.linalg.norm(left[self.free]) / max(np.linalg.norm(force), np.linalg.norm(self.weight))))
            if not out[-1] > 1e-8:
                break
            system = self.whole(positive(matrix) if way == "projected" else matrix)
            if way == "by state" and np.linalg.eigvalsh(system)[0] <= 0:
                system = self.whole(positive(matrix))
            step, part, level = np.zeros(len(x)), 1.0, self.potential(x)
            step[self.free] = np.linalg.solve(system, left[self.free])
            if way == "by state":
                while self.potential(x + part * step) > level + 1e-12 * abs(level) and part > 0.5**HALVINGS:
                    part /= 2
            x = x + part * step
        return out


def positive(matrix: np.ndarray) -> np.ndarray:
    """Symmetric matrices without their negative eigenvalues."""
    value, vector = np.linalg.eigh(matrix)
    return np.einsum("eij,ej,ekj->eik", vector, np.maximum(value, 0), vector)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=10)
    args = parser.parse_args()
    print("| speed [m/s], k [N/m], k_d [N s/m] | " + " | ".join(f"{way}: to 1e-3, 1e-6" for way in WAYS) + " |")
    print("|---" * (1 + len(WAYS)) + "|")
    for case in CASES:
        cells = []
        for way in WAYS:
            found = Sheet(args.cells, *case).solve(way)
            cells.append(", ".join(str(next((k for k, left in enumerate(found) if left < aim), "-")) for aim in (1e-3, 1e-6)))
        print(f"| {case[0]}, {case[1]}, {case[2]} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
