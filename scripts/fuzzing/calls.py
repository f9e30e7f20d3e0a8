"""Odd values for every argument of every public callable: it works sensibly, or the project's own error says why not.

A trial takes one callable out of `CALLS`, with arguments that are right, puts an odd value in place of one or two of them,
and calls it. An error that is not the project's own fails, and so does a value that is taken though nothing can be made of
it: what an object keeps must be of the kind that the right arguments give it, and finite. `scripts/fuzz.py` runs trials.
"""

import contextlib
import dataclasses
import fractions  # noqa: F401  (in ODD)
import inspect
import io
import math
import numbers
import os
import pathlib
import tempfile
import warnings
from collections.abc import Callable

import numpy as np
from fuzz import FAILED, OK, Outcome

import taichi_cloth as tc

nan, inf = math.nan, math.inf


class Odd:
    """An object that cannot even be shown."""

    def __repr__(self) -> str:
        raise RuntimeError("no words for it")


# as text, so that a failure is printed as a call that makes it again
ODD = """None "" "1" "left" "x" "nan" "a\\nb" b"1" True False nan inf -inf 0 -1 2 1.5 1e300 -1e300 1e-300 10**400 -10**400
2**63 10**19 10**9 [] () {} set() [0,1] [1,2,3,4] (1,2,3) (1,nan,3) [1e300]*3 (inf,0,0) [[1,2,3]] [[1],[2,3]] [None]*3
["a","b","c"] "abc" ("1","2","3") [10**400]*3 [True]*3 [[0,0,1]] [[0,1,99]] [[0,1,-1]] [[0.5,1,2]] np.float32(1)
np.int8(1) np.float64("nan") np.bool_(True) np.array(1.0) np.array("x") np.array(None) np.zeros(3) np.zeros((0,3))
np.zeros((2,2)) np.zeros((3,3)) np.full((9,3),nan) np.zeros((9,3)) np.zeros((2,9,3)) np.full((9,3),1e200)
np.ones((9,3),complex) np.full(9,True) np.full(3,None) np.array(["a"]*9) 1j object() Odd() print int lambda:0
lambda*a:0 lambda*a:None lambda*a:"abc" lambda*a:(nan,0,0) lambda*a:[[1],[2,3]] lambda*a:np.zeros((9,3))
lambda*a:(1e300,)*3 lambda*a:10**400 range(3) iter([1,2,3]) (i*1.0for(i)in(1,2,3)) fractions.Fraction(1,3)
np.datetime64("2020-01-01") slice(3) tc tc.Scene tc.Scene() tc.grid(1,2) tc.Fabric(1.0) tc.Sphere(1) tc.Stretch(1)
tc.Air(1.0) tc.View() {"a":1} {"a":[0]} {1:[0]} {"a":["x"]} {"a":[99]} {"":[0]} pathlib.Path("none.obj") "none\\0.obj"
"none_*.obj" "n"*5000 "metal" "f64" "verlet" "paper" "multilevel" "xz" "y" "w" """.split()

MESH, FABRIC = "tc.grid(1.0, 2)", "tc.Fabric(0.2, tc.Stretch(100))"
SCENE = f"scene = tc.Scene(); cloth = scene.add_cloth({MESH}, {FABRIC})"
BENT = SCENE.replace("tc.Stretch(100)", "tc.Stretch(100), bend=tc.Bend(1e-5)")
TORN = BENT.replace("tc.Bend(1e-5))", "tc.Bend(1e-5)), tear=tc.Tear(50.0, length=0.5)")
HELD = f"{SCENE}; ball = scene.add_solid(tc.Sphere(0.1), 0.3, 0.01); scene.attach(cloth, [0, 1], ball)"
CLOSED = "tc.TriMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])"
FULL = f"scene = tc.Scene(); cloth = scene.add_cloth({CLOSED}, {FABRIC}); scene.inflate(cloth, 5.0)"
LOADED = f"{SCENE}; load = scene.add_load(cloth, [0, 1], (0.0, 0.0, 0.1))"
BLOWN = SCENE.replace("tc.Scene()", "tc.Scene(air=tc.Air(1.0))")
CORNERS, EDGES = "[[0.0, 0], [1, 0], [0, 1]]", "(tc.Curve(0, 1), tc.Curve(1, 2), tc.Curve(2, 0))"
TRIANGLE = "[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]"

# (what comes first, what is called, right arguments in the callable's order). A name that is not given has its default.
OPTIONS = {"h": "1/60", "arch": '"cpu"', "precision": "PRECISION", "integrator": '"safe"', "K": '"projected"',
           "cg_tol": "1e-3", "adaptive": "True", "h_min": "1e-5", "stretch_limit": "0.5", "newton_max": "8",
           "preconditioner": '"auto"', "cg_max_iterations": "1000", "threads": "1", "quiet": "True", "debug": "False",
           "newton_tol": "1e-4", "contact_tol": "0.1", "tolerance": "None", "tangles": '"untangle"', "contact": '"repulsion"',
           "count_intersections": "False",
           "substep": "None", "log": "100"}
CALLS: list[tuple[str, str, dict[str, str]]] = [
    ("", "tc.TriMesh", {"x": "np.eye(3)", "faces": "[[0, 1, 2]]", "uv": "[[0.0, 0], [1, 0], [0, 1]]", "groups": '{"a": [0]}',
                        "notes": '("a note",)', "texture": "[[[0.0, 0], [1, 0], [0, 1]]]", "polygon": "[0]",
                        "weights": '{"a": [0.5]}'}),
    ("", "tc.grid", {"size": "(1.0, 2.0)", "cells": "(2, 3)", "diagonals": '"cross"', "plane": '"xy"',
                     "centred": "True"}),
    ("", "tc.strip", {"length": "2.0", "width": "1.0", "cells": "4", "diagonals": '"cross"', "plane": '"xy"',
                      "centred": "True"}),
    ("", "tc.equilateral_strip", {"length": "2.0", "rows_across": "2", "cells_along": "4", "plane": '"xy"'}),
    ("", "tc.disk", {"radius": "1.0", "rings": "2", "plane": '"xy"'}),
    ("", "tc.cylinder", {"radius": "1.0", "height": "2.0", "cells": "(5, 2)"}),
    ("", "tc.load", {"path": "OBJ", "scale": "2.0", "uv": '"flatten"', "up": '"z"', "groups": '"inside"', "only": "None"}),
    ("", "tc.load_solid", {"path": "OBJ", "scale": "2.0", "fps": "24.0", "mesh": "None", "up": '"z"', "start": "0.5",
                           "clip": "None", "merge": "False", "only": "None", "weld": "1e-4", "rest": "None"}),
    ("", "tc.Stretch", {"k": "(100.0, 80.0)", "k_d": "0.1", "b": "1.0", "limit": "1.1", "curve": "None"}),
    ("", "tc.Shear", {"k": "100.0", "k_d": "0.1", "limit": "0.3"}),
    ("", "tc.Bend", {"D": "1e-4", "k_d": "1e-6", "rest": '"flat"', "model": '"hinge"', "friction": "1e-3", "yield_": "200.0",
                 "hardening": "0.2", "recovery": "(0.1, 20.0)"}),
    ("", "tc.Fabric", {"density": "0.2", "stretch": "tc.Stretch(100)", "shear": "tc.Shear(10)", "bend": "tc.Bend(1e-4)"}),
    ("", "tc.ClothContact", {"thickness": "0.01", "friction": "0.3", "itself": "True", "layer": "1"}),
    ("", "tc.Scene", {"gravity": "(0, -9.81, 0)", "air": "tc.Air(0.5)", "view": "tc.View()"}),
    ("", "tc.Cloth", {"name": '"a"', "mesh": MESH, "fabric": FABRIC, "positions": f"{MESH}.x",
                      "velocities": "np.zeros((9, 3))", "start": "0", "color": "(0.5, 0.5, 1)",
                      "contact": "tc.ClothContact(0.01)", "panels": f"((np.array([0]), {FABRIC}),)",
                      "tear": "None", "split": "None"}),
    ("", "tc.Curve", {"start": "0", "end": "1", "kind": '"circle"', "parameters": "(1.0, False, True)", "label": '"hem"'}),
    ("", "tc.Panel", {"name": '"a"', "corners": CORNERS, "edges": EDGES, "translation": "np.zeros(3)",
                      "rotation": "np.eye(3)", "round_radius": "0.0", "grain": "0.0"}),
    ("", "tc.Stitch", {"a": '("a", 0)', "b": '("a", 1)', "together": "True", "rest": "0.5",
                       "stiffness": "2.0", "strength": "30.0"}),
    ("", "tc.Pattern", {"panels": f'(tc.Panel("a", {CORNERS}, {EDGES}),)', "stitches": '(tc.Stitch(("a", 0), ("a", 1)),)',
                       "notes": '("a note",)'}),
    ("", "tc.Garment", {"mesh": MESH, "seams": '(([0, 1], [7, 6], "flat"),)', "positions": f"{MESH}.x",
                        "fitted": "True"}),
    ("", "tc.Worn", {"garment": f"tc.Garment({MESH}, ())", "fabric": FABRIC, "contact": "tc.ClothContact(0.01)",
                     "name": '"b"', "panels": f'{{"left": {FABRIC}}}'}),
    ("", "tc.load_pattern", {"path": '"none.json"', "side": "None", "scale": "1.0", "up": '"y"', "size": "None"}),
    ("", "tc.load_garment", {"path": '"none.npz"'}),
    ("", "tc.Recording", {"path": '"none"'}),
    ("", "tc.load_stitched", {"path": "OBJ", "stitches": "None", "scale": "1.0", "positions": "None",
                             "spacing": "None", "up": '"z"'}),
    ("", "tc.remesh", {"garment": f"tc.Garment({MESH}, ())", "spacing": "0.2"}),
    ("", "tc.Air", {"normal": "0.5", "tangential": "0.1", "wind": "(1, 0, 0)", "drag": "1.0", "lift": "0.5",
                    "density": "1.2"}),
    ("", "tc.Gusts", {"mean": "(5, 0, 0)", "strength": "2.0", "length": "1.0", "seed": "3", "waves": "8"}),
    ("", "tc.Plane", {"normal": "(0, 1, 0)", "size": "1.0"}),
    ("", "tc.Sphere", {"radius": "1.0"}),
    ("", "tc.Capsule", {"a": "(0, 0, 0)", "b": "(0, 1, 0)", "radius": "0.1"}),
    ("", "tc.Box", {"size": "(1, 2, 3)", "radius": "0.1"}),
    ("", "tc.Cylinder", {"radius": "1.0", "length": "2.0"}),
    ("", "tc.SolidMesh", {"x": "np.eye(3)", "faces": "[[0, 1, 2]]", "fps": "24.0", "groups": '{"a": [0]}',
                          "start": "0.5"}),
    ("", "tc.Solid", {"name": '"a"', "shape": "tc.Sphere(1)", "friction": "0.1", "thickness": "0.01", "position": "(0, 0, 0)",
                      "rotation": "(0, 1, 0)", "color": "(0.5, 0.5, 1)", "parts": "{}"}),
    ("", "tc.Prop", {"name": '"a"', "shape": "tc.Sphere(1)", "position": "(0, 0, 0)", "rotation": "(0, 1, 0)",
                     "color": "(0.5, 0.5, 1)"}),
    ("", "tc.Tear", {"strength": "(50.0, 40.0)", "length": "0.1", "where": '"left"'}),
    ("", "tc.Camera", {"eye": "(1, 1, 1)", "target": "(0, 0, 0)", "fov": "40.0", "up": "(0, 1, 0)"}),
    ("", "tc.View", {"camera": "tc.Camera((1, 1, 1), (0, 0, 0))", "ground": "0.0", "reach": "0.1",
                     "floor": '"plain"', "background": '"#224466"', "light": "(0, 1, 0)"}),
    ("", "tc.Appearance", {"color": '"crimson"', "back": '"#102030"', "squares": "True",
                           "texture": "tc.Texture(np.zeros((2, 2, 3), np.uint8))", "weave": "tc.Weave()",
                           "panels": '{"a": "red"}', "sheen": "0.5", "specular": "0.2", "roughness": "0.3", "hem": "0.01",
                           "thickness": "0.002"}),
    ("", "tc.Texture", {"image": "np.zeros((2, 3, 4), np.uint8)", "size": "(0.1, 0.2)", "origin": "(0.0, 0.1)",
                        "repeat": "False"}),
    ("", "tc.Weave", {"spacing": "0.002", "relief": "0.5", "kind": '"twill"'}),
    ("", "tc.Options", OPTIONS),
    ("", "tc.Constraint", {"vertex": "1", "directions": '"xy"', "z": "(0, 0, 0)", "y": "(0, 0, 0)"}),
    ("from taichi_cloth.output.look import Look", "Look", {
        "quality": '"fast"', "camera": "tc.Camera((1, 1, 1), (0, 0, 0))", "orbit": "1.0", "follow": "True", "wire": "True",
        "heat": "None", "caption": '"t = {t}"', "floor": '"shadow"', "background": '"transparent"', "light": "(0, 1, 0)",
        "smooth": "1", "bits": "16", "cloths": '{"a": tc.Appearance("red")}'}),
    (f"mesh = {MESH}", "mesh.select", {"vertices": '"left"'}),
    ("air = tc.Air(1.0, 0.0, lambda t: (t, 0, 0))", "air.wind_at", {"t": "0.1", "x": "np.zeros((2, 3))"}),
    ('solid = tc.Solid("a", tc.Sphere(1), 0.1, 0.1, lambda t: (t, 0, 0), (0, 0, 0))', "solid.pose", {"t": "0.1"}),
    ('solid = tc.Solid("a", tc.Sphere(1), 0.1, 0.1, (0, 0, 0), (0, 0, 0))', "solid.surface_at", {"t": "0.1"}),
    ("mesh = tc.SolidMesh(np.zeros((2, 3, 3)) + np.eye(3), [[0, 1, 2]], 10)", "mesh.shape_at", {"t": "0.1"}),
    (SCENE, "scene.add_cloth", {"mesh": MESH, "fabric": FABRIC, "positions": f"{MESH}.x", "velocities": "(0, 0, 1)",
                                "name": '"b"', "color": "(0.5, 0.5, 1)", "contact": "tc.ClothContact(0.01)",
                                "panels": f'{{"left": {FABRIC}}}', "tear": "None"}),
    (SCENE, "scene.add_garment", {"garment": f'tc.Garment({MESH}, (([0, 1], [7, 6], "flat"),))', "fabric": FABRIC,
                                  "velocities": "(0, 0, 1)", "name": '"b"', "color": "(0.5, 0.5, 1)",
                                  "contact": "tc.ClothContact(0.01)", "panels": "None", "pull": "50.0"}),
    (BENT, "scene.crease", {"cloth": "cloth", "angle": "0.5", "edges": "None",
                             "line": "[(0.5, 0), (0.5, 1)]", "stiffness": "1.0"}),
    (SCENE, "scene.add_load", {"cloth": "cloth", "vertices": "[0, 1]", "force": "(0.0, 1.0, 0.0)"}),
    (LOADED, "scene.remove_load", {"load": "load"}),
    (BLOWN, "scene.set_wind", {"wind": "(1.0, 0.0, 0.0)"}),
    (SCENE, "scene.inflate", {"cloth": "cloth", "pressure": "5.0", "gas": '"isothermal"', "volume": "0.1", "part": "None",
                              "ambient": "1e5", "bulk": "1e6"}),
    (SCENE, "scene.sew", {"cloth": "cloth", "a": "[0, 1]", "b": "[7, 6]", "rest": "0.5", "stiffness": "1.0", "strength": "5.0",
                          "pull": "50.0"}),
    (SCENE, "scene.stitch", {"cloth": "cloth", "a": "[0, 1]", "b": "[7, 6]", "force": "3.0"}),
    (SCENE + "; seam = scene.sew(cloth, [0, 1], [7, 6])", "scene.unsew", {"seam": "seam", "vertices": "[0]"}),
    (SCENE + "; seam = scene.sew(cloth, [0, 1], [7, 6])", "scene.resew", {"seam": "seam", "vertices": "[0]"}),
    (TORN, "scene.score", {"cloth": "cloth", "line": "[(0.5, 0), (0.5, 1)]", "fraction": "0.5"}),
    (FULL, "scene.deflate", {"cloth": "cloth", "part": "None"}),
    (HELD, "scene.detach", {"cloth": "cloth", "vertices": "[0]"}),
    (SCENE + "; ball = scene.add_solid(tc.Sphere(1), 0.1, 0.01)", "scene.attach",
     {"cloth": "cloth", "vertices": "[0, 1]", "solid": "ball", "since": "0.1", "stiffness": "100.0", "most": "5.0"}),
    (SCENE, "scene.add_solid", {"shape": "tc.Sphere(1)", "friction": "0.1", "thickness": "0.01",
                                "position": "lambda t: (t, 0, 0)", "rotation": "(0, 1, 0)", "name": '"b"',
                                "color": "(0.5, 0.5, 1)", "parts": "None"}),
    (SCENE, "scene.set_fabric", {"cloth": "cloth", "fabric": '"denim"', "panels": "True"}),
    (SCENE, "scene.add_prop", {"shape": "tc.Sphere(1)", "position": "lambda t: (t, 0, 0)", "rotation": "(0, 1, 0)",
                               "name": '"b"', "color": "(0.5, 0.5, 1)"}),
    (SCENE, "scene.pin", {"cloth": "cloth", "vertices": "[0, 1]", "directions": '"xy"', "stiffness": "9.0"}),
    (SCENE, "scene.move", {"cloth": "cloth", "vertices": "[0, 1]", "path": "lambda t: (t, 0, 0)", "relative": "True",
                           "directions": '"xy"', "stiffness": "None", "most": "None"}),
    (SCENE + "; scene.pin(cloth, [0, 1])", "scene.unpin", {"cloth": "cloth", "vertices": "[0]"}),
    (SCENE, "scene.at", {"t": "0.1", "f": "lambda s: None"}),
    (SCENE, "scene.add_force", {"make": "lambda fields, model, scene, K: None"}),
    (SCENE, "scene.add_mass", {"cloth": "cloth", "vertices": "[0, 1]", "mass": "0.1"}),
    (SCENE + f"; other = scene.add_cloth({MESH}, {FABRIC})", "scene.pass_through", {"a": "cloth", "b": "other"}),
]
SIMULATED = "; sim = tc.Simulation(scene, precision=PRECISION, threads=1)"
STARTED = SCENE + SIMULATED
MAY_BE_INFINITE = ("bears",)  # what never gives
MAY_BE_NONE = ("h", "cg_tol", "h_min", "threads", "newton_tol", "contact_tol", "tolerance", "substep",  # of the options
               "sheen", "specular", "roughness", "hem", "thickness")  # of looks
# These start Taichi.
RUNNING: list[tuple[str, str, dict[str, str]]] = [
    (SCENE, "tc.Simulation", {"scene": "scene", **OPTIONS}),
    (STARTED, "sim.set_state", {"x": "sim.positions()", "v": "sim.velocities()"}),
    (STARTED, "sim.forces", {"renew": "True"}),
    (STARTED, "sim.product", {"p": "sim.positions()", "h": "1/60"}),
    (STARTED, "sim.right_hand_side", {"h": "1/60"}),
    (STARTED, "sim.solve", {"h": "1/60", "constraints": "[tc.Constraint(0)]"}),
    (STARTED, "sim.step", {"h": "1/60"}),
    (STARTED, "sim.run", {"duration": "0.02", "fps": "60", "on_frame": "lambda sim, frame: None", "resumed": "None"}),
    ("body = tc.Scene()", "tc.dress", {"garment": f"tc.Garment({MESH}, ())", "fabric": FABRIC, "body": "body",
                                       "contact": "None", "longest": "0.1", "h": "1/60", "tell": "None", "pull": "5.0",
                                       "meets": "True", "over": "()", "name": '"b"', "panels": "None"}),
    ("body = tc.Scene()", "tc.fitted", {"garment": f"tc.Garment({MESH}, ())", "body": "body", "thickness": "0.01",
                                        "turn": "10.0", "parts": '("a", "b")'}),
    ("", "tc.sweep", {"build": "lambda k, seed: None", "grid": '{"k": [1.0]}', "metrics": "lambda sim: 1.0", "seeds": "2",
                      "duration": "0.1", "fps": "10.0", "out": "None", "workers": "0", "scheduler": "None", "slurm": "None",
                      "tls": "None", "dashboard": "None", "say": "print"}),
    ("", "tc.fit", {"kind": '"strip"', "data": '{"strain": [0.01, 0.02, 0.03], "force": [1.0, 2.1, 2.9]}', "density": "None",
                    "width": "0.05", "length": "None", "D": "1e-5", "k": "1000.0", "find": '"k"', "range_": "None",
                    "confidence": "0.95", "rings": "15", "cells": "12", "h": "1/240", "workers": "0", "out": "None",
                    "say": "print"}),
    (STARTED, "sim.checked_run", {"duration": "0.02", "fps": "60"}),
    (STARTED, "tc.record", {"sim": "sim", "out": "tempfile.mkdtemp()", "duration": "0.02", "fps": "60",
                            "on_frame": "lambda sim, frame: None", "overwrite": "False", "checkpoint_every": "10",
                            "name": '"sheet"'}),
    (STARTED, "sim.resume", {"state": "sim.checkpoint()", "edited": "False"}),
    (STARTED, "sim.count_on", {"other": "sim"}),
    (STARTED, "sim.recall", {"records": "list(sim.log)"}),
    (LOADED + SIMULATED, "sim.add_load", {"cloth": "cloth", "vertices": "[0, 1]", "force": "(0.0, 1.0, 0.0)"}),
    (LOADED + SIMULATED, "sim.remove_load", {"load": "load"}),
    (BLOWN + SIMULATED, "sim.set_wind", {"wind": "(1.0, 0.0, 0.0)"}),
    (STARTED, "sim.pin", {"cloth": "cloth", "vertices": "[0, 1]", "directions": '"y"', "stiffness": "None"}),
    (STARTED + "; sim.pin(cloth, [0, 1])", "sim.unpin", {"cloth": "cloth", "vertices": "[0]"}),
    (STARTED, "sim.move", {"cloth": "cloth", "vertices": "[0, 1]", "path": "lambda t: (0.0, t, 0.0)", "relative": "True",
                           "directions": "None", "stiffness": "None", "most": "None"}),
    (STARTED.replace("sim =", "ball = scene.add_solid(tc.Sphere(0.1), 0.3, 0.01); sim ="), "sim.attach",
     {"cloth": "cloth", "vertices": "[0, 1]", "solid": "ball", "since": "None", "stiffness": "None", "most": "None"}),
    (HELD + SIMULATED, "sim.detach", {"cloth": "cloth", "vertices": "[0]"}),
    (SCENE + "; seam = scene.sew(cloth, [0, 1], [7, 6])" + SIMULATED, "sim.unsew", {"seam": "seam", "vertices": "[0]"}),
    (SCENE + "; seam = scene.sew(cloth, [0, 1], [7, 6])" + SIMULATED, "sim.resew", {"seam": "seam", "vertices": "[0]"}),
    (FULL + SIMULATED, "sim.inflate", {"cloth": "cloth", "pressure": "5.0", "gas": '"constant"', "volume": "None",
                                       "part": "None", "ambient": "1e5", "bulk": "1e6"}),
    (FULL + SIMULATED, "sim.deflate", {"cloth": "cloth", "part": "None"}),
    (STARTED, "tc.render", {"what": "sim", "path": "None", "frame": "None", "size": "(32, 16)", "quality": '"fast"',
                            "heat": '"stretch"', "limits": "(0.9, 1.1)", "camera": "tc.Camera((1, 1, 1), (0, 0, 0))",
                            "wire": "True", "caption": '"{t}"', "orbit": "1.0", "follow": "True", "background": '"white"',
                            "floor": '"none"', "light": "(0, 1, 0)", "appearance": 'tc.Appearance("red")', "smooth": "1",
                            "bits": "16", "aperture": "0.01", "focus": "1.5", "shutter": "0.0"}),
    (STARTED, "tc.passes", {"what": "sim", "frame": "None", "size": "(32, 16)", "names": '("id",)'}),
    (STARTED, "tc.render_frames", {
        "recording": "sim", "folder": '"film"', "frames": '"1:2"', "size": "(32, 16)", "heat": "None", "limits": "None",
        "passes": "()", "pass_format": '"exr"', "sheet": "0", "apng": "False", "mp4": "False"}),
]
# What a right argument may also be, and so stays as it is.
FUNCTIONS = ("wind", "position", "rotation")
WORDS = ("0", "-1", "nan", "inf", "-inf", "1e400", "1e-400", "1/0", "1/", "/", "", "x", "1e-300", "9" * 30, "9" * 5000, "²",
         "None", "1,2", ":", "1:2", "0:0", "{", "{x}", "\n", "--", "1=2", "n=x", "n=-1", "n=nan", "verlet", "f64", "0x10",
         "1e9")


def trial(seed: int, precision: str) -> Outcome:
    """One call; a tenth of them of what starts Taichi, a tenth of the command line."""
    rng = np.random.default_rng(seed)
    kind = rng.uniform()
    if kind < 0.1:
        return _typed(rng, precision)
    calls = RUNNING if kind < 0.2 else CALLS
    before, what, right = calls[rng.integers(len(calls))]
    arguments, names = dict(right), list(right)
    for name in rng.permutation(names)[: 1 + (rng.uniform() < 0.2)]:
        arguments[str(name)] = _corrupted(rng, right[str(name)])
    return judge(before, what, right, arguments, precision)


def judge(before: str, what: str, right: dict[str, str], arguments: dict[str, str], precision: str) -> Outcome:
    """Calls, and says what came of it."""
    text = f"{before}\n{what}({', '.join(f'{k}={v}' for k, v in arguments.items())})"
    with _aside() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        known = {**globals(), "PRECISION": precision, "OBJ": str(folder / "a.obj")}
        exec(before, known)
        values = {name: eval(v, known) for name, v in arguments.items()}
        try:
            made = eval(what, known)(**values)
        except tc.ClothError:
            return Outcome(OK)
        except Exception as error:
            return Outcome(FAILED, f"{type(error).__name__}: {str(error)[:200]}\n{text}")
        if isinstance(made, tc.Simulation):
            return _steps(made, text)
        model = eval(what, known)(**{name: eval(v, known) for name, v in right.items()}) if what[:3] == "tc." else None
        wrong = [name for name in arguments if model is not None and hasattr(made, name)
                 and not _alike(getattr(made, name), getattr(model, name), name)]
        wrong += [] if made is None or _finite(made) else ["what it returns"]
    return Outcome(FAILED, f"taken in silence: {', '.join(wrong)}\n{text}") if wrong else Outcome(OK)


def _steps(sim: tc.Simulation, text: str) -> Outcome:
    """A simulation that was made takes a step, or says why not."""
    try:
        sim.step()
        if not np.isfinite(sim.positions()).all():
            return Outcome(FAILED, f"positions that are not finite\n{text}")
    except tc.ClothError:
        return Outcome(OK)
    except Exception as error:
        return Outcome(FAILED, f"a step: {type(error).__name__}: {str(error)[:200]}\n{text}")
    finally:
        sim.close()
    return Outcome(OK)


def _typed(rng: np.random.Generator, precision: str) -> Outcome:
    """A command line with an odd word."""
    from taichi_cloth.app import cli

    actions = [a for a in _flags(cli) if a.option_strings and a.dest not in ("help", "out", "to")]
    action, word = actions[rng.integers(len(actions))], WORDS[rng.integers(len(WORDS))]
    argv = ["run", "hang", "--set", "cells=2", "--duration", "0.02", "--fps", "50", "--no-images", "--threads", "1",
            "--precision", precision, action.option_strings[-1], *([word] if action.nargs != 0 else [])]
    said = io.StringIO()
    with _aside(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = cli.main(argv)
        except SystemExit as error:
            code = error.code
        except Exception as error:
            return Outcome(FAILED, f"{type(error).__name__}: {str(error)[:200]}\ntaichi-cloth {argv}")
    text = said.getvalue()
    if code in (0, 2, 3) and (code == 0 or "error" in text):
        return Outcome(OK)
    return Outcome(FAILED, f"exit code {code}: {text[-300:]}\ntaichi-cloth {argv}")


def _flags(cli) -> list:
    """Flags of `run`."""
    parser = cli._parser()
    return next(a for a in parser._actions if a.dest == "command").choices["run"]._actions


def _corrupted(rng: np.random.Generator, right: str) -> str:
    """An odd value, or a right one made wrong."""
    if rng.uniform() < 0.8:
        return ODD[rng.integers(len(ODD))]
    ways = ("[{0}]", "({0}, {0})", "str({0})", "(lambda *a: {0})", "np.array({0})", "np.array({0}, dtype=object)",
            "-np.array({0})", "np.array({0}) * nan", "np.array({0})[..., None]", "np.array([{0}] * 2)",
            "list(np.ravel({0}))[:-1]")
    text = ways[rng.integers(len(ways))].format(right)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            eval(text, {**globals(), **dict.fromkeys(("scene", "cloth", "other", "sim")), "OBJ": "a.obj", "PRECISION": "f64"})
    except Exception:  # nothing that can be written so
        return ODD[rng.integers(len(ODD))]
    return text


def _alike(value: object, model: object, name: str) -> bool:
    """Whether a kept value is of the kind that a right argument gives."""
    if name in FUNCTIONS and callable(value):
        return True
    if value is None:  # arguments that may be left out
        return name in ("uv", "groups", "fps", "rest", "stretch", "shear", "bend", "air", "view", "color", "contact", "camera",
                        "ground", "mesh", "heat", "directions", "limit", "curve", "yield_", "tear", "split", "texture",
                        *MAY_BE_NONE)
    if name == "where":  # vertices, by whatever names them
        return value is None or isinstance(value, str) or _finite(value)
    if name == "rest" and isinstance(value, tuple):  # angles of edges
        return _finite(value)
    if isinstance(model, (bool, str)) or dataclasses.is_dataclass(model) or isinstance(model, tc.Scene):
        shape = name == "shape" and isinstance(value, (tc.Plane, tc.Sphere, tc.Capsule, tc.Box, tc.Cylinder, tc.SolidMesh))
        return shape or name == "directions" or isinstance(value, type(model))
    if name in ("notes", "mesh", "camera", "heat"):
        return _finite(value)
    return not isinstance(value, str) and not callable(value) and not dataclasses.is_dataclass(value) and _finite(value)


def _finite(value: object) -> bool:
    """Whether all numbers in a value are, and nothing else is in it but texts and the project's own objects."""
    if dataclasses.is_dataclass(value):
        return all(_finite(getattr(value, f.name)) for f in dataclasses.fields(value) if f.name not in MAY_BE_INFINITE)
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, (tuple, list)):
        return all(map(_finite, value))
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fiub" and bool(np.isfinite(value).all())
    if isinstance(value, numbers.Number):
        return isinstance(value, numbers.Real) and math.isfinite(value)
    return value is None or isinstance(value, (str, pathlib.Path, tc.Scene, tc.Recording)) or callable(value)


@contextlib.contextmanager
def _aside():
    """A folder of its own to work in."""
    here = pathlib.Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield pathlib.Path(folder)
        finally:
            os.chdir(here)


def missing() -> list[str]:
    """What of the package's public names and their arguments the tables do not have."""
    there = {what: set(right) for _, what, right in CALLS + RUNNING}
    out = []
    for name in set(tc.__all__) - {"__version__", "run", "view", "MembraneLaw", "BendLaw"}:
        # run takes the process's flags, and ends it; a page stays; laws are made by a simulation
        thing = getattr(tc, name)
        if not callable(thing) or isinstance(thing, type) and issubclass(thing, Exception):
            continue
        out += [f"tc.{name}({a})" for a in set(_arguments(thing)) - there.get(f"tc.{name}", set())]
    for kind, name in ((tc.Scene, "scene"), (tc.Simulation, "sim")):
        for method, thing in inspect.getmembers(kind, inspect.isfunction):
            if method[0] != "_" and method not in ("running", "fire", "passes", "view"):  # what only a simulation calls
                out += [f"{name}.{method}({a})" for a in set(_arguments(thing)) - there.get(f"{name}.{method}", set())]
    return out


def _arguments(thing: Callable) -> list[str]:
    return [name for name, p in inspect.signature(thing).parameters.items() if name != "self" and p.kind is not p.VAR_KEYWORD]
