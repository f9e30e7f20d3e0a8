"""Vertices that springs with a largest force hold to solids: forces, derivatives, work, events and what they give for."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.step.ledger import totals

FABRIC = tc.Fabric(0.2, tc.Stretch(500, 0.5), tc.Shear(50), tc.Bend(1e-4))
CONVERGED = {"newton_tol": 1e-11, "cg_tol": 1e-12, "newton_max": 60}
STIFF, MOST = 30.0, 0.2  # N/m, N


def away(path=None, **attach) -> tuple[tc.Scene, tc.Cloth, tc.Solid]:
    """A sheet that hangs far above a ball, to which its upper edge is attached."""
    flat = tc.grid(0.4, 4)
    scene, mesh = tc.Scene(), tc.TriMesh(flat.x[:, [0, 2, 1]] * [1, -1, 1], flat.faces, flat.uv, groups=flat.groups)
    ball = scene.add_solid(tc.Sphere(0.1), 0.3, 0.01, position=path or (0.0, -3.0, 0.0), name="ball")
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.attach(cloth, "top", ball, **attach)
    return scene, cloth, ball


def energies(x, place, row, k, most):
    d = np.linalg.norm(x[row] - place, axis=1)
    return np.where(k * d <= most, k * d**2 / 2, most * d - most**2 / (2 * k))


@pytest.fixture(scope="module", params=["paper", "projected"])
def hung(request):
    scene, cloth, _ = away(stiffness=STIFF, most=MOST)
    sim = tc.Simulation(scene, h=1 / 60, K=request.param, integrator="backward_euler")
    yield sim, cloth.mesh.select("top"), request.param
    sim.close()


@pytest.mark.slow
def test_derivatives(hung, rng):
    """f = -dE/dx, and K = df/dx on a ladder, on both sides of the largest force; "projected" is no less stiff."""
    sim, row, K = hung
    x = sim.scene.cloths[0].mesh.x
    place, noise, p = x[row], rng.normal(size=x.shape), rng.normal(size=x.shape)
    for size in (1e-3, 5e-2):  # within and beyond MOST / STIFF = 6.7 mm
        there, zero = x.copy(), 0 * x
        sim.set_state(x, zero)
        sim.prescribed.set_time(0.0)  # attached here
        there[row] += size * noise[row]
        own = STIFF * size * np.linalg.norm(noise[row], axis=1)
        assert (own < MOST).all() if size < 1e-2 else (own > MOST).all()

        def pulls(eps, there=there):
            sim.model.write(there + eps * p, zero)
            return sim.attachment_forces(), sim.energy()["attachments"], sim.forces()

        f, E, total = pulls(0.0)
        assert pytest.approx(energies(there, place, row, STIFF, MOST).sum(), rel=1e-12) == E
        low, high = pulls(-1e-6), pulls(1e-6)
        assert np.sum(f * p) == pytest.approx(-(high[1] - low[1]) / 2e-6, rel=1e-7)
        pulls(0.0)
        n = np.zeros((len(x), 1))
        n[sim.model.user, 0] = sim.model.mass
        one, two = (n * p - sim.product(p, h) for h in (1.0, 2.0))
        K_p = two / 2 - one
        errors = []
        for eps in 10.0 ** -np.arange(3, 7):
            errors.append(np.abs((pulls(eps)[2] - pulls(-eps)[2]) / (2 * eps) - K_p)[row].max() / np.abs(K_p).max())
        if K == "paper":
            assert min(errors) < 1e-7, errors
        else:  # of a first solve: a bound
            assert np.sum(p * K_p) <= np.sum(p * (high[2] - low[2])) / 2e-6 < 0


@pytest.mark.slow
def test_it_hangs_where_forces_balance():
    """At rest springs bear the weight; beyond their largest force the sheet falls at (m g - sum of forces)/m."""
    scene, cloth, _ = away(stiffness=100.0)
    sim = tc.Simulation(scene, h=1 / 30, integrator="backward_euler")
    sim.run(4.0, fps=1)
    weight = sim.model.mass.sum() * 9.81
    pull, row = sim.attachment_forces(), cloth.mesh.select("top")
    assert pull.sum(axis=0) == pytest.approx([0, weight, 0], abs=2e-3 * weight)
    sunk = cloth.mesh.x[row] - sim.positions()[row]
    assert pull[row] == pytest.approx(100.0 * sunk, abs=1e-9) and sunk[:, 1].max() > 5e-4
    assert not np.delete(pull, row, axis=0).any()
    most, h = 0.6 * weight / len(row), 1 / 60
    sim.detach(cloth)
    sim.attach(cloth, row, sim.scene.solids[0], stiffness=1e4, most=most)
    sim.step(h)  # a single solve knows the largest force from the step on in which it is reached
    for _ in range(20):
        before = sim.model.mass @ sim.velocities()[sim.model.user]
        sim.step(h)
        gained = sim.model.mass @ sim.velocities()[sim.model.user] - before
        pull = sim.attachment_forces()
        assert gained == pytest.approx(h * (pull.sum(axis=0) + [0, -weight, 0]), abs=2e-3 * h * weight)
    assert np.linalg.norm(pull[row], axis=1) == pytest.approx(most, rel=1e-9) and sim.positions()[row, 1].max() < 0.2
    sim.close()


@pytest.mark.slow
def test_what_hangs_by_springs_alone_takes_no_more_iterations():
    """Springs to a prop: their solves need no more iterations than with a ball far below, which only says that forces from
    outside may be there, and the cloth hangs where exact solves have it."""
    flat, took, low = tc.grid(0.5, 10), [], []
    for ball, cg_tol in ((False, 1e-4), (True, 1e-4), (False, 1e-9)):
        scene = tc.Scene()
        cloth = scene.add_cloth(flat, FABRIC)
        scene.attach(cloth, "top", scene.add_prop(tc.Box((0.5, 0.01, 0.01)), position=(0.25, 0.5, 0)), stiffness=2000.0)
        if ball:
            scene.add_solid(tc.Sphere(0.1), 0.3, 0.01, position=(0, -5, 0))
        sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler", cg_tol=cg_tol)
        for _ in range(20):
            sim.step()
        took.append(sum(r.iterations for r in sim.log))
        low.append(sim.positions()[:, 1].min())
        sim.close()
    assert took[0] < 1.2 * took[1] and abs(low[0] - low[2]) < 1e-3


@pytest.mark.parametrize("integrator", ["newton_euler", "tr_bdf2"])
@pytest.mark.slow
def test_all_of_their_work_is_accounted_for(integrator):
    """A ball that swings, drags a sheet by springs; some are let go by an event, others begin: nothing is unaccounted for."""
    scene, cloth, ball = away(lambda t: (0.02 * np.sin(25 * t), -3.0 + 0.2 * t, 0.3 * t), stiffness=STIFF, most=MOST)
    row = cloth.mesh.select("top")
    scene.at(4 / 90, lambda: scene.detach(cloth, row[:2]))
    scene.at(6 / 90, lambda: scene.attach(cloth, [0, 1], ball, 6 / 90, stiffness=50.0, most=1.0))
    sim = tc.Simulation(scene, h=1 / 90, integrator=integrator, stretch_limit=9.0, **CONVERGED)
    before, works, held = sum(sim.energy().values()), [], []
    for _ in range(9):
        sim.log.clear()
        held.append(len(sim.prescribed.pulled(sim.time).index))
        sim.step()
        after = sum(sim.log[-1].energies.values())
        ledger = totals([r.ledger for r in sim.log])
        assert ledger["kinetic"] + ledger["potential"] == pytest.approx(after - before, abs=1e-9)
        scale = abs(ledger["attachments"]) + ledger["damping"] + abs(ledger["method"]) + sim.log[-1].energies["kinetic"]
        assert abs(ledger["unaccounted"]) < 1e-6 * scale, ledger
        before = after
        works.append(ledger["attachments"])
    assert held == [5, 5, 5, 5, 3, 3, 5, 5, 5]
    assert sum(w for w in works if w > 0) > 1e-3, works
    sim.close()


@pytest.mark.slow
def test_explicit_steps_count_the_work_of_places_that_move():
    """A sheet that is drawn by springs without damping: its energy grows by that work, as taken from the path, f . dg."""
    flat, scene = tc.grid(0.4, 4), tc.Scene()
    mesh = tc.TriMesh(flat.x[:, [0, 2, 1]] * [1, -1, 1], flat.faces, flat.uv, groups=flat.groups)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(200.0), tc.Shear(40.0), tc.Bend(1e-5)))

    def path(t):
        return np.array([0.3 * (1 - np.cos(5 * t)), 0.1 * (1 - np.cos(9 * t)), 0.0])

    row, k, most = mesh.select("top"), 200.0, 0.5
    scene.move(cloth, row, path, relative=True, stiffness=k, most=most)
    with tc.Simulation(scene, h=1 / 60, integrator="verlet", threads=1) as sim:
        for _ in range(18):
            sim.step(1 / 60)
        booked, off = (sum(r.ledger[name] for r in sim.log) for name in ("attachments", "unaccounted"))
    work, before = 0.0, None
    with tc.Simulation(scene, h=1 / 1920, integrator="verlet", threads=1) as sim:
        for _ in range(576):
            sim.step()
            g = mesh.x[row] + path(sim.time)
            away = sim.positions()[row] - g
            d = np.linalg.norm(away, axis=1)
            f = (np.minimum(k, most / np.maximum(d, 1e-12)))[:, None] * -away
            work += 0.0 if before is None else float(np.sum((f + before[0]) / 2 * (g - before[1])))
            before = f, g
    assert abs(work) > 0.01 and booked == pytest.approx(work, rel=0.03) and abs(off) < 1e-3 * work


@pytest.mark.slow
def test_events_by_hand_and_checkpoints():
    def make() -> tuple[tc.Simulation, tc.Cloth, tc.Solid]:
        scene, cloth, ball = away(lambda t: (0.3 * t, -3.0, 0.0), stiffness=STIFF, most=MOST)
        scene.at(0.1, lambda: scene.detach(cloth))
        scene.at(0.2, lambda: scene.attach(cloth, "bottom", ball, 0.2, stiffness=500.0))
        return tc.Simulation(scene, h=1 / 50, threads=1), cloth, ball

    sim, cloth, ball = make()
    sim.run(0.1, fps=50)
    assert not sim.attachment_forces().any()
    sim.run(0.16, fps=50)
    low = cloth.mesh.select("bottom")
    pull = sim.attachment_forces()
    assert (np.linalg.norm(pull[low], axis=1) > 0).all() and not np.delete(pull, low, axis=0).any()
    state = sim.checkpoint()
    sim.run(0.1, fps=50)
    x = sim.positions()
    sim.detach(cloth, low[0])
    assert not sim.attachment_forces()[low[0]].any() and sim.attachment_forces()[low[1]].any()
    sim.attach(cloth, low[0], ball, stiffness=10.0, most=1.0)
    sim.step()
    sim.close()
    again, _, _ = make()
    again.resume(state)
    again.run(0.1, fps=50)
    assert (again.positions() == x).all()
    again.close()


@pytest.mark.slow
def test_springs_along_a_path_pull_as_those_to_a_prop_that_goes_the_same_way():
    """In the scene, and by hand, positions are those of an attachment to what moves along; on the way it is let go."""
    mesh, law, ends = tc.grid(0.4, 4), {"stiffness": STIFF, "most": MOST}, []

    def path(t: float) -> tuple[float, float, float]:
        return 0.4 * t, 0.3 * t, 2.0 * t * t

    for way in ("prop", "scene", "by hand"):
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, FABRIC)
        prop = scene.add_prop(tc.Box((0.5, 0.01, 0.01)), position=path)
        if way == "scene":
            scene.move(cloth, "top", path, relative=True, **law)
        else:
            scene.attach(cloth, "top", prop, **law)
        with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
            if way == "by hand":
                sim.detach(cloth)
                sim.move(cloth, "top", path, relative=True, **law)
            sim.run(0.3, fps=20)
            pull = np.linalg.norm(sim.attachment_forces(), axis=1)
            assert (pull <= MOST * (1 + 1e-9)).all() and (pull[cloth.mesh.select("top")] > 0).all(), way
            sim.unpin(cloth)
            assert not sim.attachment_forces().any(), way
            sim.run(0.1, fps=20)
            ends.append(sim.positions())
    assert np.abs(ends[0] - mesh.x).max() > 0.05
    assert ends[1] == pytest.approx(ends[0], abs=1e-9) and ends[2] == pytest.approx(ends[0], abs=1e-9)


@pytest.mark.slow
def test_what_is_soft_gives_where_a_solid_presses():
    """A ball presses on the middle of a sheet that is attached there to the floor: soft it gives way, hard it is squeezed,
    which rejected steps say, with what to do."""
    sim, ball = pressed(stiffness=20.0, most=0.5)
    sim.run(0.2, fps=30)
    at = sim.positions()[24]
    assert np.linalg.norm(at - ball.pose(sim.time)[1]) > 0.05 + 0.5 * 0.003
    assert np.linalg.norm(sim.attachment_forces()[24]) == pytest.approx(0.5, rel=0.2)
    assert not any(r.rejections for r in sim.log)
    sim.close()
    sim, ball = pressed()
    sim.run(0.2, fps=30)
    assert np.linalg.norm(sim.positions()[24] - ball.pose(sim.time)[1]) < 0.05
    told = [str(t) for r in sim.log for t in r.troubles if t.name]
    assert told and all("vertex 24 " in t and "'ball'" in t and "held hard" in t and "stiffness" in t for t in told), told
    sim.close()


def pressed(**attach) -> tuple[tc.Simulation, tc.Solid]:
    """A sheet on a ball's way down, one of whose vertices is attached to the floor."""
    scene, mesh = tc.Scene(), tc.grid(0.3, 6)
    floor = scene.add_solid(tc.Plane((0, 1, 0)), 0.3, 0.003, position=(0, -1, 0), name="floor")
    ball = scene.add_solid(tc.Sphere(0.05), 0.3, 0.003, position=lambda t: (0.15, 0.06 - 0.3 * t, -0.15), name="ball")
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.attach(cloth, 24, floor, **attach)
    scene.pin(cloth, "left")
    return tc.Simulation(scene, h=1 / 60), ball


def test_what_cannot_be_attached_softly():
    scene, cloth, ball = away(stiffness=STIFF)
    with pytest.raises(tc.SceneError, match="stiffness"):
        scene.attach(cloth, "bottom", ball, most=1.0)
    for law in ({"stiffness": 0.0}, {"stiffness": 1.0, "most": -1.0}, {"stiffness": np.nan}):
        with pytest.raises(tc.SceneError, match="attach"):
            scene.attach(cloth, "bottom", ball, **law)
        with pytest.raises(tc.SceneError, match="move"):
            scene.move(cloth, "bottom", lambda t: (0, 0, 0), True, **law)
    with pytest.raises(tc.SceneError, match="move: .*stiffness"):
        scene.move(cloth, "bottom", lambda t: (0, 0, 0), True, most=1.0)
    with pytest.raises(tc.SceneError, match="move: .*directions"):
        scene.move(cloth, "bottom", lambda t: (0, 0, 0), True, "y", stiffness=1.0)
    with pytest.raises(tc.SceneError, match="already held"):
        scene.pin(cloth, "top")
    with pytest.raises(tc.SceneError, match="detach: no such vertex"):
        scene.detach(cloth, "bottom")
    scene.pin(cloth, "bottom")
    scene.detach(cloth)
    assert [a.solid for a in scene.script.attachments] == [None]  # the pin stays
    sim = tc.Simulation(scene)
    with pytest.raises(tc.SceneError, match="without soft attachments"):
        sim.attach(cloth, "top", ball, stiffness=STIFF)
    with pytest.raises(tc.SceneError, match="move: .*without soft attachments"):
        sim.move(cloth, "top", lambda t: (0, 0, 0), True, stiffness=STIFF)
    sim.close()
