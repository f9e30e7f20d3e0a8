"""Checks of the mathematics on a user's own scene, in the state that it reaches: derivatives, momentum, constraints.

Every check gives a figure and whether it is within the rounding of float64. Solids, wind and pins are taken out where a
check speaks of the cloth alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from .. import checks
from ..scene.air import Air
from ..scene.cloth import Cloth
from ..scene.mesh import TriMesh
from ..scene.scene import Scene
from ..simulation import Simulation
from ..solver.pcg import CONVERGED
from ..system.elements import lumped_mass

LADDER = 10.0 ** -np.arange(3, 9)  # of the cloth's size, that a derivative is tried with
DERIVATIVE, EXACT, DRIFT, SOLVED = 1e-5, 1e-11, 1e-12, 1e-7
PATCH = 60  # faces of the piece on which CG is held against a direct solve
SEED = 20_260_801

Check = tuple[str, str, bool]


def verify(make: Callable[[], Scene], t: float, simulate: type[Simulation] = Simulation) -> Iterator[Check]:
    """(check, figure, whether it holds) at time t [s] of a scene's run.

    Args:
        make: builds the scene anew.
        simulate: makes the simulation to check, from a scene and options: a test hands in one that is wrong.

    Raises:
        SceneError: t is no time. SimulationError: the scene does not run up to t.
    """
    t = checks.number("time", t, "s", positive=True)
    sim = simulate(make())
    yield from _run_to(sim, t)
    x, v = sim.positions(), sim.velocities()
    sim.close()
    bare = make()
    bare.solids.clear()
    bare.script.attachments.clear()
    bare.script.events.clear()
    yield from _forces(bare, x, v, simulate)
    bare.air, bare.gravity = None, np.zeros(3)
    yield from _momentum(bare, x, v, simulate)
    yield from _fall(make(), simulate)
    cloth = bare.cloths[0]
    yield _against_direct(cloth, x[cloth.start: cloth.start + cloth.whole.vertex_count], simulate)


def _run_to(sim: Simulation, t: float) -> Iterator[Check]:
    """Runs the scene; how exactly its pins were held at every frame, and whether every solve converged."""
    worst, size = 0.0, float(np.abs(sim.positions()).max()) or 1.0

    def look(sim: Simulation, frame: int) -> None:
        nonlocal worst
        held = sim.prescribed.held(sim.time) if frame and not sim.scene.touches else None
        if held is not None:
            off = sim.positions()[sim.model.user[held.index]] - sim.model.origin - held.target
            worst = max(worst, float(np.abs(np.einsum("kij,kj->ki", held.projector, off)).max()))

    sim.run(t, 1 / min(t, 1 / 60), look)
    if sim.prescribed.script.attachments and not sim.scene.touches:
        yield "pins drift by at most", f"{worst:.1e} m", worst <= DRIFT * max(size, 1.0)
    statuses = {r.status for r in sim.log} - {"CONVERGED", "EXPLICIT"}
    yield "every solve of every step converged", ", ".join(statuses) or f"{len(sim.log)} steps", not statuses


def _forces(scene: Scene, x: np.ndarray, v: np.ndarray, simulate: type[Simulation]) -> Iterator[Check]:
    """f = -dE/dx, K p and D p against differences of f, symmetry."""
    rng = np.random.default_rng(SEED)
    air, scene.air = scene.air, None
    sim = simulate(scene, K="paper")
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    p = rng.standard_normal(x.shape)
    rest = np.zeros_like(v)

    def energy(y: np.ndarray) -> float:
        sim.set_state(y, rest)
        return sum(e for name, e in sim.energy().items() if name != "kinetic")

    sim.set_state(x, rest)
    f = sim.forces()
    error = _ladder(lambda e: (energy(x + e * size * p) - energy(x - e * size * p)) / (2 * e * size), float(-(f * p).sum()))
    yield "force against differences of the energy", f"{error:.1e} relative", error < DERIVATIVE

    def force(y: np.ndarray, u: np.ndarray, renew: bool = True) -> np.ndarray:
        sim.set_state(y, u)
        return sim.forces(renew)

    sim.set_state(x, rest)
    K_p, D_p = _products(sim, p)
    error = _ladder(lambda e: (force(x + e * size * p, rest) - force(x - e * size * p, rest)) / (2 * e * size), K_p)
    yield "stiffness product against differences of the force", f"{error:.1e} relative", error < DERIVATIVE
    q = rng.standard_normal(x.shape)
    sim.set_state(x, rest)
    A_p, A_q = sim.product(p, 1 / 60), sim.product(q, 1 / 60)
    error = abs((q * A_p).sum() - (p * A_q).sum()) / (np.linalg.norm(q) * np.linalg.norm(A_p))
    yield "the matrix is symmetric", f"{error:.1e} relative", error < EXACT
    sim.close()
    scene.air = air and _as_at_first(air)
    sim = simulate(scene, K="paper")
    sim.set_state(x, v)
    K_p, D_p = _products(sim, p)
    if np.linalg.norm(D_p) > EXACT * np.linalg.norm(K_p):
        kept = air is not None and air.local  # coefficients of a step's start
        error = _ladder(lambda e: (force(x, v + e * p, not kept) - force(x, v - e * p, not kept)) / (2 * e), D_p)
        yield "damping product against differences of the force", f"{error:.1e} relative", error < DERIVATIVE
    sim.close()


def _as_at_first(air: Air) -> Air:
    """Air whose wind stays as it is at t = 0: products at several h are then of one matrix."""
    if air.varies_in_space:
        return replace(air, wind=lambda x, t: air.wind_at(0.0, x))
    return replace(air, wind=air.wind_at(0.0))


def _momentum(scene: Scene, x: np.ndarray, v: np.ndarray, simulate: type[Simulation]) -> Iterator[Check]:
    """Internal forces neither push nor turn the cloth; damping takes energy."""
    sim = simulate(scene)
    sim.set_state(x, v)
    f = sim.forces()
    size = float(np.abs(f).sum()) or 1.0
    error = float(np.abs(f.sum(axis=0)).max()) / size
    yield "internal forces add up to", f"{error:.1e} of their size", error < EXACT
    error = float(np.abs(np.cross(x, f).sum(axis=0)).max()) / (size * (float(np.abs(x).max()) or 1.0))
    yield "their torques add up to", f"{error:.1e} of their size", error < EXACT
    sim.set_state(x, np.zeros_like(v))
    power = float(((f - sim.forces()) * v).sum())
    if power:
        yield "damping takes power", f"{power:.2e} W", power <= 0
    sim.close()


def _fall(scene: Scene, simulate: type[Simulation]) -> Iterator[Check]:
    """The scene's cloth without pins, solids and wind falls as everything does: by its speed, the same for all methods."""
    if not scene.gravity.any():
        return
    scene.solids.clear()
    scene.script.attachments.clear()
    scene.script.events.clear()
    scene.air = None
    mass = np.zeros(scene.vertex_count)
    for cloth in scene.cloths:
        mass[cloth.start: cloth.start + cloth.mesh.vertex_count] = lumped_mass(cloth.mesh, cloth.density)
        cloth.velocities[:] = 0
        object.__setattr__(cloth, "contact", None)  # seams and masses are of this very cloth
    for cloth, vertices, extra in scene.masses:
        mass[vertices + cloth.start] += extra
    sim = simulate(scene, h=1 / 100)
    t = 0.1
    sim.run(t, 10)
    speed = (mass[:, None] * sim.velocities()).sum(axis=0) / mass.sum()
    error = float(np.linalg.norm(speed - scene.gravity * t) / np.linalg.norm(scene.gravity * t))
    yield "cut loose it falls with g, off by", f"{error:.1e} relative", error < 1e-3
    sim.close()


def _against_direct(cloth: Cloth, x: np.ndarray, simulate: type[Simulation]) -> Check:
    """CG against a dense direct solve, on a piece of the cloth as it is."""
    mesh = cloth.whole
    faces = mesh.faces[_patch(mesh.faces, PATCH)]
    index = np.searchsorted(np.unique(faces), np.arange(len(x)))
    picked = np.isin(np.arange(len(mesh.faces)), _patch(mesh.faces, PATCH))
    piece = TriMesh(x[np.unique(faces)], index[mesh.faces[picked]], mesh.corner_uv[picked])
    scene = Scene()
    small = scene.add_cloth(piece, cloth.fabric)
    scene.pin(small, [0])
    sim = simulate(scene, cg_tol=1e-12)
    n, h = sim.vertex_count, 1 / 60
    A = np.stack([sim.product(unit.reshape(n, 3), h).ravel() for unit in np.eye(3 * n)], axis=1)
    b, free = sim.right_hand_side(h).ravel(), np.arange(3 * n) >= 3
    exact = np.zeros(3 * n)
    exact[free] = np.linalg.solve(A[np.ix_(free, free)], b[free])
    dv = sim.solve(h).ravel()
    error = float(np.abs(dv - exact).max() / (np.abs(exact).max() or 1.0))
    good = sim.solution is not None and sim.solution.status == CONVERGED
    sim.close()
    what = f"CG against a direct solve on {len(piece.faces)} of its triangles"
    return what, f"{error:.1e} relative", good and error < SOLVED


def _patch(faces: np.ndarray, count: int) -> np.ndarray:
    """Indices of up to `count` faces, grown from the first by shared edges."""
    edges: dict[tuple[int, int], list[int]] = {}
    for k, face in enumerate(faces.tolist()):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            edges.setdefault((min(face[a], face[b]), max(face[a], face[b])), []).append(k)
    taken, front = {0}, [0]
    while front and len(taken) < count:
        face = faces[front.pop(0)].tolist()
        for a, b in ((0, 1), (1, 2), (2, 0)):
            for other in edges[min(face[a], face[b]), max(face[a], face[b])]:
                if other not in taken and len(taken) < count:
                    taken.add(other)
                    front.append(other)
    return np.array(sorted(taken))


def _products(sim: Simulation, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K p, D p) out of A p = (M - h D - h^2 K) p at steps 0+, h and 2 h."""
    h = 1.0
    A_1, A_2, A_3 = (sim.product(p, k * h) for k in (1, 2, 3))
    K_p = -(A_3 - 2 * A_2 + A_1) / (2 * h**2)
    D_p = -(A_2 - A_1) / h - 3 * h * K_p
    return K_p, D_p


def _ladder(difference: Callable[[float], np.ndarray | float], exact: np.ndarray | float) -> float:
    """The best relative error on the ladder of steps."""
    size = float(np.linalg.norm(exact)) or 1.0
    return min(float(np.linalg.norm(difference(e) - exact)) / size for e in LADDER)
