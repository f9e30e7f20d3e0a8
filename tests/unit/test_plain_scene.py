"""A scene of plain cloth has nothing of what it does not name: no module, force, field or recorded array."""

import importlib.util
import json
import subprocess
import sys

import pytest

ABSENT = ("forces.gas", "forces.hysteresis", "forces.curvature_bend", "forces.curvature_hysteresis", "forces.closing",
          "forces.loads", "forces.local_drag", "forces.stress", "system.enclosures", "system.stitches",
          "tearing.stitch_failure", "tearing.tears", "contact", "contact.contacts", "output.recording")
CODE = """
import json, sys
import taichi_cloth as tc
scene = tc.Scene()
cloth = scene.add_cloth(tc.grid(0.2, 4), tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50), tc.Bend(1e-4)))
scene.pin(cloth, "top_left")
sim = tc.Simulation(scene, h=1 / 60, threads=1)
record = sim.step()
loaded = [m.removeprefix("taichi_cloth.") for m in sys.modules if m.startswith("taichi_cloth.")]
membrane, bend, gravity = sim.force_terms
from taichi_cloth.recording import record as recording
print(json.dumps({
    "loaded": loaded, "forces": [type(f).__name__ for f in sim.force_terms], "remembers": bend.has_extra_torque,
    "follows": any(force.follows_steps for force in sim.force_terms),
    "energies": sorted(sim.energy()), "ledger": sorted(record.ledger), "stiffens": membrane.stiffening is not None,
    "sewn": sim.model.sewn is not None, "gives": sim.stitch_failure is not None, "remembered": len(sim.model.remembered),
    "low_rank": sim.meter.operator.has_low_rank,
    "frame": sorted(recording.frame(sim)), "geometry": sorted(recording.geometry(sim)),
    "checkpoint": sorted(sim.checkpoint())}))
"""


@pytest.mark.slow
def test_what_a_scene_does_not_name_is_not_there():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    told = json.loads(done.stdout.splitlines()[-1])
    for module in ABSENT:
        assert importlib.util.find_spec(f"taichi_cloth.{module}") is not None, module
    assert not set(told["loaded"]) & set(ABSENT)
    assert told["forces"] == ["Membrane", "Bend", "Gravity"]
    assert told["energies"] == ["bend", "gravity", "kinetic", "shear", "stretch_u", "stretch_v"]
    for name in ("remembers", "follows", "stiffens", "sewn", "gives", "remembered", "low_rank"):
        assert not told[name], name
    assert told["frame"] == ["t", "v", "x"]
    for name in ("sewn", "corners", "creases", "face_limit", "hinge_own", "patches"):
        assert name not in told["geometry"]
    assert not [key for key in told["checkpoint"] if "sliders" in key or key.startswith(("stitches", "gas", "contacts"))]
