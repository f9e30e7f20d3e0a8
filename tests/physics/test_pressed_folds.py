"""Folds that are pressed flat and let go: the angle that stays, by the yield law, hinge by hinge."""

import numpy as np
import pytest
from reference.rest import hinges
from test_creases import HEIGHT, D, hinge, turned

import taichi_cloth as tc

H, YIELD, CELL, COLUMNS = 0.1, 300.0, 1e-3, 17  # 1/m, m
FOLD = slice(6, 11)  # columns between which the strip is free to bend; those beyond are led as one, as by a plate


@pytest.mark.parametrize("most, integrator", [(np.pi, "backward_euler"), (-np.pi, "newton_euler"), (3.4, "newton_euler"),
                                              (-3.4, "backward_euler")])
def test_a_hinge_folded_flat_and_beyond_stays_as_the_yield_law_says(most, integrator):
    """(1 - H) (pi - yield) to 1e-3, to either side; led through itself it stays through, bent by as much as before."""
    bend = tc.Bend(D, 2e-9, yield_=200.0, hardening=H)
    scene = hinge(bend, lambda t: most * min(1.0, 4 * t), release=0.3)
    with tc.Simulation(scene, h=1 / 240, stretch_limit=9.0, integrator=integrator) as sim:
        sim.run(1.5, 10)
        assert not any(r.rejections for r in sim.log)
        led = np.minimum(4 / 240 * np.arange(61), 1) * abs(most)
        bent = np.minimum(led, 2 * np.pi - led).max()
        side = np.sign(most) * np.sign(np.pi + 1e-9 - abs(most))
        assert side * turned(sim) == pytest.approx((1 - H) * (bent - 200 * HEIGHT), abs=1e-3)


def pressed(gap=1.2e-3, led=0.5):
    """A strip of one row of cells, folded over till `led` [s], pressed to `gap` [m], let go at 2 led: (scene, column)."""
    mesh = tc.grid(((COLUMNS - 1) * CELL, 4 * CELL), (COLUMNS - 1, 1))
    s = mesh.x[:, 0] - mesh.x[:, 0].min()
    column = np.round(s / CELL).astype(int)
    plate, start, length = np.flatnonzero(column >= FOLD.stop - 1), FOLD.start * CELL, (FOLD.stop - 1 - FOLD.start) * CELL

    def path(t):
        angle = max(np.pi * min(1.0, t / led), 1e-6)
        radius, beyond = length / angle, s[plate] - (FOLD.stop - 1) * CELL
        down = np.interp(t, [led, 1.8 * led], [0, 2 * length / np.pi - gap])
        return np.column_stack([mesh.x[:, 0].min() + start + radius * np.sin(angle) + beyond * np.cos(angle),
                                radius * (1 - np.cos(angle)) + beyond * np.sin(angle) - down, mesh.x[plate, 2]])

    scene = tc.Scene(gravity=None)
    bend = tc.Bend(D, 2e-9, yield_=YIELD, hardening=H)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.1, tc.Stretch(200, 1e-3), tc.Shear(50, 1e-4), bend))
    scene.pin(cloth, np.flatnonzero(column <= FOLD.start))
    scene.move(cloth, plate, path)
    scene.at(2 * led, lambda s: s.unpin(cloth, plate))
    return scene, column


def angles(rest, x):
    """(hinges,) turned by [rad], from positions."""
    i, j, a, b = (x[[h["vertices"][k] for h in rest]] for k in range(4))
    e, n_a, n_b = j - i, np.cross(j - i, a - i), np.cross(b - i, j - i)
    along = np.einsum("ki,ki->k", np.cross(n_a, n_b), e) / np.linalg.norm(e, axis=1)
    return np.arctan2(along, np.einsum("ki,ki->k", n_a, n_b))


@pytest.mark.slow
def test_a_strip_folded_flat_pressed_and_let_go():
    """Each hinge comes to (1 - H) q, q where its slider went: within the yield of the angles that it came to; that is
    (1 - H) (angle - yield) where it was bent most; 1e-3. It stays so."""
    scene, column = pressed()
    rest = hinges(scene.cloths[0].mesh)
    x = scene.cloths[0].mesh.x
    give = YIELD * np.array([np.linalg.norm(x[h["vertices"][1]] - x[h["vertices"][0]]) / h["weight"] for h in rest])
    slider, most = np.zeros(len(rest)), np.zeros(len(rest))
    with tc.Simulation(scene, h=1 / 240, stretch_limit=9.0, integrator="backward_euler") as sim:
        def step():
            sim.step()
            bent = angles(rest, sim.positions())
            slider[:] = np.clip(slider, bent - give, bent + give)
            most[np.abs(bent) > np.abs(most)] = bent[np.abs(bent) > np.abs(most)]
            return bent

        while sim.time < 1 - 1e-9:
            step()
        x = sim.positions()
        low, high = x[column <= FOLD.start], x[column >= FOLD.stop - 1]
        assert np.ptp(low[:, 1]) < 1e-12 and np.ptp(high[:, 1]) < 1e-12  # flat on itself
        assert high[:, 1].mean() - low[:, 1].mean() == pytest.approx(1.2e-3, abs=1e-9)
        while sim.time < 2 - 1e-9:
            stays = step()
        assert np.abs(stays - (1 - H) * slider).max() < 1e-3
        sharp = np.abs(most).argmax()
        assert abs(stays[sharp]) == pytest.approx((1 - H) * (abs(most[sharp]) - give[sharp]), abs=1e-3)
        assert abs(most[sharp]) > 1.5 and (np.abs(slider) > 0.01).sum() >= 6
        for _ in range(2000):
            sim.step()
        assert np.abs(angles(rest, sim.positions()) - stays).max() < 1e-6
