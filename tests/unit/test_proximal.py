"""The proximal gradient method for contacts, against the conditions of the problem's minimum with a dense matrix."""

import numpy as np

import taichi_cloth as tc
from taichi_cloth.backend.rows import read, write
from taichi_cloth.contact.solid.balance import Balance
from taichi_cloth.solver import proximal
from taichi_cloth.solver.proximal import ProximalGradient
from taichi_cloth.step.nonlinear.solved_contact import SolvedStep
from taichi_cloth.system.cones import Cones

H = 1 / 60


def across(rows: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return rows - np.sum(rows * normal, axis=1, keepdims=True) * normal


class Problem:
    """A sheet of 36 particles that moves anyhow. A third of them has a contact, one in two of these a cone; four particles
    stay. The smooth part is 1/2 dv^T A dv - b^T dv."""

    def __init__(self, rng: np.random.Generator) -> None:
        mesh, scene = tc.grid(0.3, 5), tc.Scene()
        fabric = tc.Fabric(0.2, tc.Stretch(1000, 1), tc.Shear(100, 0.1), tc.Bend(1e-4))
        scene.add_cloth(mesh, fabric, mesh.x + 0.01 * rng.normal(size=mesh.x.shape), rng.normal(size=mesh.x.shape))
        scene.add_solid(tc.Sphere(0.1), 0.4, 0.005, position=(0, -9, 0))
        self.sim = tc.Simulation(scene, h=H, integrator="backward_euler")
        self.sim.product(0 * mesh.x, H)  # A
        self.system = self.sim.integrator.system
        n = self.n = self.system.model.n
        self.method = ProximalGradient(self.system._fields, self.system.solver)
        self.A = np.array([self.method._product(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)])
        self.b = 0.05 * rng.normal(size=(n, 3))
        write(self.system.operator.b, self.b)
        index = np.arange(0, n, 3)
        normal = rng.normal(size=(len(index), 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        size = np.abs(rng.normal(size=len(index))) * 0.05 * (np.arange(len(index)) % 2)
        stays = np.zeros(n, dtype=bool)
        stays[[1, 2, 10, 20]] = True
        self.cones = Cones(index, normal, size, 0.1 * rng.normal(size=normal.shape), stays, np.zeros((n, 6)), np.zeros((n, 3)))
        self.rest = self.cones.way.copy()  # from dv = 0
        self.set(np.zeros((n, 3)))

    def set(self, dv: np.ndarray) -> None:
        write(self.system.solver.dv, dv)

    def dv(self) -> np.ndarray:
        return read(self.system.solver.dv)

    def force(self, dv: np.ndarray) -> np.ndarray:
        return (self.A @ dv.ravel()).reshape(-1, 3) - self.b

    def value(self, dv: np.ndarray) -> float:
        slip = across(dv[self.cones.index] - self.rest, self.cones.normal)
        return float(0.5 * dv.ravel() @ self.A @ dv.ravel() - np.sum(self.b * dv)
                     + np.sum(self.cones.size * np.linalg.norm(slip, axis=1)))


def test_it_ends_where_coulombs_law_holds_and_no_contact_pulls(rng, monkeypatch):
    monkeypatch.setattr(proximal, "ITERATIONS", 6000)
    p = Problem(rng)
    slips, pressed = p.method.run(p.cones)
    dv, c = p.dv(), p.cones
    g, scale = p.force(dv), np.linalg.norm(p.b)
    free = ~c.stays
    free[c.index] = False
    assert np.abs(g[free]).max() < 1e-7 * scale and not dv[c.stays].any()
    opens, normal = np.sum((dv[c.index] - p.rest) * c.normal, axis=1), np.sum(g[c.index] * c.normal, axis=1)
    closed = normal > 1e-6 * scale
    assert 2 < closed.sum() < len(closed) - 2  # some open, some do not
    assert np.abs(opens[closed]).max() < 1e-12 and opens.min() > -1e-12 and normal.min() > -1e-7 * scale
    assert np.allclose(pressed, np.maximum(normal, 0), atol=1e-6 * scale)
    assert np.allclose(slips, dv[c.index] - p.rest, atol=1e-12)
    slip, across_it = across(slips, c.normal), across(g[c.index], c.normal)
    sticks = closed & (np.linalg.norm(slip, axis=1) == 0)
    slides = closed & ~sticks
    assert sticks.any() and (slides & (c.size > 0)).any()
    assert (np.linalg.norm(across_it[sticks], axis=1) <= c.size[sticks] + 1e-7 * scale).all()
    ways = slip[slides] / np.linalg.norm(slip[slides], axis=1, keepdims=True)
    assert np.abs(across_it[slides] + c.size[slides, None] * ways).max() < 1e-6 * scale


def test_each_run_makes_the_sum_less_also_after_a_step_that_went_too_far(rng):
    """A linear solve may lead anywhere: runs begin from the least value between their last end and there."""
    p = Problem(rng)
    p.method.run(p.cones)
    before = p.value(p.dv())
    for far in (0.3, 3.0, 300.0):
        end = p.method.ended.copy()
        wild = end + far * rng.normal(size=end.shape) * ~p.cones.stays[:, None]
        p.set(wild)
        p.method._shorten(p.cones, p.rest, wild.copy(), end)
        assert p.value(p.dv()) <= before + 1e-12 < p.value(wild)
        moved = p.dv() - end
        others = [p.value(end + part * moved) for part in np.linspace(0, 1, 21)]
        assert p.value(p.dv()) <= min(others) + 1e-6 * abs(before)
        before = p.value(p.dv())
        p.method.ended = p.dv().copy()


def test_launch_by_launch_it_is_the_same(rng):
    p = Problem(rng)
    p.method.run(p.cones)
    together = p.dv()
    p.set(np.zeros((p.n, 3)))
    p.method.ended, p.system.solver.together = None, False
    p.method.run(p.cones)
    assert np.abs(p.dv() - together).max() < 1e-12 * np.abs(together).max()


def test_friction_that_the_system_has_is_taken_out_once(rng):
    p = Problem(rng)
    block, push = np.zeros((p.n, 6)), np.zeros((p.n, 3))
    block[3], push[3] = 0.01, 0.2
    b, P = read(p.system.operator.b), read(p.system.operator.P)
    p.method._take(Cones(**{**vars(p.cones), "block": block, "push": push}), p.rest)
    assert np.allclose(read(p.system.operator.b), b - push) and np.allclose(read(p.system.operator.P), P - block)


def test_steps_use_it_where_they_are_far_from_the_law_and_only_there(monkeypatch):
    """A sheet falls on a ball, in steps that are not solved: iterations follow solves that are off by more than 3 %, and none
    that is better."""
    from taichi_cloth.contact.contacts import NEAR, Contacts

    seen, runs, judge, run = [], [], Contacts.judge, ProximalGradient.run
    monkeypatch.setattr(Contacts, "judge",
                        lambda self, *given: (judge(self, *given), seen.append(self.found.residual.relative))[0])
    monkeypatch.setattr(ProximalGradient, "run", lambda self, cones: runs.append(seen[-1]) or run(self, cones))
    scene, mesh = tc.Scene(), tc.grid(0.6, 12)
    fabric = tc.Fabric(0.15, tc.Stretch(1000, 1), tc.Shear(50, 0.1), tc.Bend(1e-5))
    scene.add_cloth(mesh, fabric, mesh.x + [-0.3, 0.21, 0.3])
    scene.add_solid(tc.Sphere(0.2), 0.4, 0.005)
    with tc.Simulation(scene, h=H, threads=1, contact_tol=None) as sim:
        for _ in range(20):
            sim.step()
        assert max(r.contact_error for r in sim.log) < 0.06
    assert len(runs) > 20 and min(runs) > NEAR and sum(off <= NEAR for off in seen) > 10


def test_friction_of_contacts_that_open_in_the_iterations_is_at_right_angles_to_their_normals(monkeypatch):
    """In solved steps, where iterations open a contact that the law keeps, its slip has no part along the normal: friction
    along that part presses cloth into the solid, and grows with the pressure from solve to solve."""
    tilts, relaxed, relax, solved = [], Balance.relaxed, SolvedStep.relax, []

    def relaxing(self):
        solved.append(self)
        relax(self)
        solved.pop()

    def watched(self, found, slip, pressed):
        out = relaxed(self, found, slip, pressed)
        tilts.extend([np.abs(np.sum(out.rows.push * out.f.normal, axis=1)).max(initial=0.0)] * len(solved))
        return out

    monkeypatch.setattr(Balance, "relaxed", watched)
    monkeypatch.setattr(SolvedStep, "relax", relaxing)
    scene, mesh = tc.Scene(), tc.grid(0.6, 12)
    fabric = tc.Fabric(0.15, tc.Stretch(1000, 1), tc.Shear(50, 0.1), tc.Bend(1e-5))
    scene.add_cloth(mesh, fabric, mesh.x + [-0.3, 0.21, 0.3])
    scene.add_solid(tc.Sphere(0.2), 0.4, 0.005)
    with tc.Simulation(scene, h=H, threads=1, contact_tol=0.1) as sim:
        for _ in range(12):
            sim.step()
    assert len(tilts) > 10 and max(tilts) < 1e-9
