"""A run that goes on with an edited scene: its ledger has what the edit put in, beside a count from positions."""

import json

import numpy as np
import pytest
from reference.energy import energies

import taichi_cloth as tc
from taichi_cloth.step.ledger import totals
from taichi_cloth.system.checkpoint import VERSION, understood

CLOTH = {"density": 0.15, "stretch": 1000.0, "bend": 5e-5}
EDITS = {"nothing": {}, "softer": {"stretch": 100.0}, "stiffer": {"stretch": 2e4}, "bent": {"bend": 5e-2},
         "unbent": {"bend": 1e-7}, "heavy": {"density": 1.0}, "light": {"density": 0.03}}
METHODS = ("safe", "tr_bdf2", "bdf2", "backward_euler", "newton_euler", "verlet")


def hung(integrator: str, air: tc.Air | None = None, **fabric: float) -> tc.Simulation:
    """A sheet that swings from a corner."""
    of, scene = {**CLOTH, **fabric}, tc.Scene(air=air)
    cloth = scene.add_cloth(tc.grid(0.5, 4), tc.Fabric(of["density"], tc.Stretch(of["stretch"], 1.0), tc.Shear(100.0),
                                                       tc.Bend(of["bend"])))
    scene.pin(cloth, "top_left")
    return tc.Simulation(scene, h=1 / 60, integrator=integrator)


def kept(sim: tc.Simulation) -> dict[str, np.ndarray]:
    return {name: np.array(value) for name, value in sim.checkpoint().items()}


@pytest.mark.parametrize("air", [None, tc.Air(drag=0.5, lift=0.2, wind=(3.0, 0.0, 2.0))], ids=["calm", "wind"])
@pytest.mark.parametrize("integrator", METHODS)
@pytest.mark.slow
def test_cloth_of_another_material_goes_on(integrator, air):
    """Every edit that a fabric can have: none gives up, and what it changed stands in the first step's ledger."""
    with hung(integrator, air) as sim:
        sim.run(0.2, fps=10)
        state, before = kept(sim), sum(energies(sim))
    for name, edit in EDITS.items():
        with hung(integrator, air, **edit) as sim:
            sim.resume(state)
            made = sum(energies(sim)) - before
            sim.step()
            rows = [r.ledger for r in sim.log]
            total, after = totals(rows), sum(energies(sim))
            assert rows[0]["edited"] == pytest.approx(made, abs=1e-12) and not any(r["edited"] for r in rows[1:]), name
            assert (made == 0) == (name == "nothing")
            assert total["kinetic"] + total["potential"] == pytest.approx(after - before, abs=1e-12)
            if integrator != "backward_euler":  # a single linear solve leaves more undone, in any step
                assert abs(total["unaccounted"]) < 0.02 * max(abs(made), energies(sim)[0]), name


def test_another_method_begins_anew_where_it_is_said_that_the_scene_was_edited():
    with hung("verlet") as sim:
        sim.step()
        state = kept(sim)
    with hung("backward_euler") as sim:
        with pytest.raises(tc.SceneError, match="of the integrator 'verlet', and this simulation's is 'backward_euler'"):
            sim.resume(state)
        sim.resume(state, edited=True)
        assert any("integrator was 'verlet'" in note for note in sim.notes) and not sim.step().ledger["edited"]


def test_what_is_changed_by_hand_between_steps_is_booked():
    """A state that is set: energies of steps and of what came between add up to those of positions."""
    with hung("backward_euler") as sim:
        sim.step()
        first, x, v = sum(energies(sim)), sim.positions(), sim.velocities()
        sim.set_state(x + [0.0, 0.3, 0.0], 2 * v)
        set_to = sum(energies(sim))
        record = sim.step()
        last = sum(energies(sim))
    assert record.ledger["edited"] == pytest.approx(set_to - first, abs=1e-12)
    assert record.ledger["kinetic"] + record.ledger["potential"] == pytest.approx(last - first, abs=1e-12)


def test_a_checkpoint_refuses_what_it_does_not_know():
    with hung("backward_euler") as sim:
        state = kept(sim)
        for name in ("force.Heater.0.warmth", "contacts.warm", "particles.state_wear", "step.more"):
            with pytest.raises(tc.SceneError, match=f"has {name}, of which this scene has nothing"):
                sim.resume({**state, name: np.array(1.0)})
        sim.resume({**state, "contacts.warm": np.array(True)}, edited=True)
        assert any("contacts.warm" in note for note in sim.notes)


def test_a_checkpoint_of_versions_before_is_understood():
    """Version 11 said neither which integrator it was of nor what was stored, 12 what is asked for no more: both go on."""
    with hung("backward_euler") as sim:
        sim.step()
        state = kept(sim)
        told = json.loads(str(state["felt"]))
        assert {"Membrane.0", "Bend.0", "Gravity.0", "kinetic"} == set(told)
        sim.step()
        x = sim.positions()
    old = {k: a for k, a in state.items() if k not in ("integrator", "felt", "step.last", "step.dropped")}
    with hung("backward_euler") as sim:
        for before in ({**old, "version": np.array(11)},
                       {**state, "version": np.array(12), "contacts.foresight.mends": np.array(1)}):
            sim.resume(before)
            sim.step()
            assert (sim.positions() == x).all()
        with pytest.raises(tc.SceneError, match="version 10, .* from versions 11 to 16"):
            sim.resume({**old, "version": np.array(10)})


def test_names_of_version_13_are_read_as_they_are_now():
    """Those of contacts and methods; forces and particles keep theirs."""
    old = {"contacts.layers.was": 1, "contacts.layers.firmness.boost": 2, "contacts.solids.growth.part": 3,
           "contacts.foresight.rounds": 4, "integrator.accurate.debt": 5, "force.Own.0.was": 6, "particles.boost": 7,
           "contacts.layers.detector.paths.walked": 8}
    now = understood({"version": np.array(13), **old}, "safe", ["Own.0"])
    assert now.pop("version") == VERSION == 16 and now.pop("contacts.layers.shift.parts") == 0
    assert list(now) == ["contacts.layers.least_before", "contacts.layers.adaptive_stiffness.scale",
                         "contacts.solids.thickness_ramp.part", "contacts.forcing_terms.rounds",
                         "integrator.accurate.accumulated_gain", "force.Own.0.was", "particles.boost",
                         "contacts.layers.detector.paths.known_end"]
    assert list(now.values()) == list(old.values())


def test_what_version_13_did_not_keep_of_pinched_cloth():
    """Particles that were spared may be inside a solid, and are looked for there; nothing is known to be across."""
    spared = "contacts.solids.penetration.spared"
    now = understood({"version": np.array(13), spared: np.array([0.0, 0.1, 0.0])}, "safe", [])
    assert now["contacts.solids.penetration.sought"].tolist() == [False, True, False]
    assert now["contacts.solids.penetration.across"].tolist() == [False] * 3 and len(now) == 4


def test_version_14_did_not_keep_shifts_and_kept_all_else():
    kept = {"contacts.layers.kept.key": np.arange(2), "contacts.layers.kept.friction": np.ones((2, 3)),
            "contacts.layers.kept.slip": np.ones(2), "contacts.layers.adaptive_stiffness.scale": np.full(5, 4.0),
            "contacts.solids.pinches.accepted.index": np.arange(3),
            "contacts.solids.pinches.accepted.friction": np.ones((3, 3))}
    now = understood({"version": np.array(14), **kept}, "safe", [])
    assert now.pop("version") == VERSION and (now.pop("contacts.layers.shift.parts") == np.zeros(5)).all()
    order = [now.pop(f"contacts.solids.pinches.order.{name}") for name in ("key", "side")]
    assert [len(rows) for rows in order] == [0, 0], "nothing is known of layers between solids"
    assert set(now) == set(kept) and all((now[key] == kept[key]).all() for key in kept)


@pytest.mark.parametrize("pairs", [0, 2])
def test_friction_that_version_13_did_not_keep_is_none(pairs):
    old = {"contacts.layers.kept.key": np.arange(pairs), "contacts.solids.pinches.accepted.index": np.arange(3)}
    now = understood({"version": np.array(13), **old}, "safe", [])
    friction, slip = (now[f"contacts.layers.kept.{name}"] for name in ("friction", "slip"))
    assert friction.shape == (pairs, 3) and not friction.any() and slip.shape == (pairs,) and np.isinf(slip).all()
    assert now["contacts.solids.pinches.accepted.friction"].shape == (3, 3)
