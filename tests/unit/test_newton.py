"""Newton's method on a backward Euler step of cloth alone, against matrices by numpy (`scripts/study_newton.py`)."""

import sys
from pathlib import Path

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.step.nonlinear.newton import CG_TOL, FURTHER, LEAVES, PRELIMINARY, SURE, Forcing, NewtonTolerance

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import study_newton as study  # noqa: E402

H, CELLS = study.H, 8


def simulation(sheet, **options) -> tc.Simulation:
    """The study's sheet, which is thrown down and held at one side."""
    k, k_d = sheet.k, sheet.k_d
    fabric = tc.Fabric(study.DENSITY, tc.Stretch(k, k_d), tc.Shear(k / 10, k_d / 10))
    scene, mesh = tc.Scene(gravity=(0, -study.GRAVITY, 0)), tc.grid(1.0, CELLS)
    cloth = scene.add_cloth(mesh, fabric, sheet.x.reshape(-1, 3), sheet.v.reshape(-1, 3))
    scene.pin(cloth, np.setdiff1d(np.arange(mesh.vertex_count), sheet.free // 3))
    return tc.Simulation(scene, h=H, stretch_limit=99.0, **options)


def off(sheet, x: np.ndarray) -> float:
    """How far the forces of a step to x are from balance, over all of them."""
    f = sheet.of_triangles(sheet.gradients(x), "energy")[1]
    force = np.zeros(len(x))
    np.add.at(force, sheet.rows, np.einsum("eij,ei->ej", sheet.spread, sheet.area[:, None] * f))
    left = sheet.weight - force - sheet.mass * ((x - sheet.x) / H - sheet.v) / H
    return float(np.linalg.norm(left[sheet.free]) / np.linalg.norm(force))


def taken(sheet, x: np.ndarray, v: np.ndarray | None = None) -> float:
    """What damping takes in a step to x [J]; with velocities v, half of its power there [W]."""
    total, now, before = 0.0, sheet.gradients(x), sheet.w
    for part in (slice(0, 3), slice(3, 6)):
        size = np.linalg.norm(now[:, part], axis=1)
        rate = (size - np.linalg.norm(before[:, part], axis=1)) / H
        if v is not None:
            rate = np.einsum("ei,ei->e", now[:, part], sheet.gradients(v)[:, part]) / size
        total += sheet.k_d * np.sum(sheet.area * rate**2)
    rate = (np.einsum("ei,ei->e", now[:, :3], now[:, 3:]) - np.einsum("ei,ei->e", before[:, :3], before[:, 3:])) / H
    if v is not None:
        rate = np.einsum("ei,ei->e", now @ study.SWAP, sheet.gradients(v))
    total += sheet.k_d / 10 * np.sum(sheet.area * rate**2)
    return total * H if v is None else total / 2


@pytest.mark.parametrize("speed, k, k_d, most", [(5, 5000, 5, 12), (15, 5000, 5, 14)])
def test_forces_come_to_balance_and_damping_is_what_they_say(monkeypatch, speed, k, k_d, most):
    """From far away in a few iterations, and at last by the square of how far they are off; and the step's ledger has it."""
    from taichi_cloth.step.nonlinear.linear_system import System

    sheet, seen = study.Sheet(CELLS, speed, k, k_d), []
    sim = simulation(sheet, integrator="newton_euler", cg_tol=1e-8, newton_tol=1e-10, newton_max=40)
    solve = System.solve

    def watched(self, *args, **kwargs):
        seen.append(sim.positions().ravel())
        return solve(self, *args, **kwargs)

    monkeypatch.setattr(System, "solve", watched)
    row = sim.step()
    x, v = sim.positions().ravel(), sim.velocities().ravel()
    found = [off(sheet, at) for at in seen] + [off(sheet, x)]
    assert not row.rejections and len(found) <= most + 3, found
    k_1 = next(i for i, value in enumerate(found) if value < 1e-2)
    assert k_1 <= most and found[k_1 + 1] < 0.1 * found[k_1] and found[k_1 + 2] < 1e-7, found
    np.testing.assert_allclose((x - sheet.x) / H, v, atol=1e-9)
    assert row.ledger["damping"] == pytest.approx(taken(sheet, x), rel=1e-6) and row.ledger["damping"] > 1e-4
    scale = sum(abs(value) for value in row.ledger.values())
    assert abs(row.ledger["unaccounted"]) < 1e-7 * scale
    assert sim.stepper.start.damped == pytest.approx(taken(sheet, x, v), rel=1e-9)  # as the next step may ask for it
    sim.close()


def test_solves_are_as_exact_as_forces_are_near_to_balance():
    exact = NewtonTolerance(1e-4, 0.0, PRELIMINARY, FURTHER, CG_TOL)
    forcing = Forcing.of(None, exact)
    assert forcing.follows and forcing.next(2.0) == PRELIMINARY
    assert forcing.next(1.0) == FURTHER and not forcing.enough(1.0) and forcing.enough(LEAVES / 2)
    assert forcing.next(0.1) == pytest.approx(SURE * 0.01) and forcing.enough(1.0)
    assert forcing.next(0.4) == FURTHER and forcing.left == pytest.approx(0.4 * FURTHER) and forcing.enough(1.0)
    assert forcing.next(1e-6) == CG_TOL and forcing.most == 2.0 and LEAVES < FURTHER
    asked = Forcing.of(1e-6, exact)
    assert (asked.first, asked.further, asked.last, asked.mending) == (1e-6,) * 4 and not asked.follows
    assert Forcing.of(1e-6, None).mending == 1e-6 and Forcing.of(None, None).mending == FURTHER
    single = Forcing.of(None, None)
    assert (single.first, single.further, single.preliminary) == (CG_TOL, CG_TOL, PRELIMINARY) and not single.follows
