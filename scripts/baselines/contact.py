"""Cloth on a ball, or a slope, by one of the programs that pip installs, as a program of its own: no import of taichi_cloth.

    PYTHON scripts/baselines/contact.py NAME task.npz result.npz

`bench_peers.py --contact` writes the task and reads the result. Exit code 3 where the program is not installed in PYTHON.
How the numbers of a fabric are mapped to each program's own is said at each function.
"""

import json
import sys
import time
from collections.abc import Callable

import numpy as np

ABSENT = 3  # exit code
FPS = 60
GRAVITY = 9.81
SIDE = 8.0  # m, of a plate
FAR = 1000.0  # m, radius of a ball that stands for a plate
Run = tuple[Callable[[], object], int, Callable[[], np.ndarray], str]  # a frame, how many in a second, positions, what it is


def blender(s: dict) -> Run:
    """Blender's cloth: springs along the edges of quads and across them, so shear springs are where Blender has them.

    A frame of Blender's, of five steps, is sqrt(1e-3) s at any frame rate (made 1/30 s here), and a spring of tension t
    carries 1000 t / a newtons per metre, a the mean edge: both as measured, in free fall and in a hanging strip. Springs k
    along edges and c across quads carry k + c N/m in stretch, c in shear. `bending_stiffness`, whose unit is not
    documented, is 10 D: an order of magnitude, from how far a strip of 20 edges sags. Damping is 0; friction of 1 is taken
    for .01 of Coulomb's. Object and self distances are the thickness.
    """
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    stage.gravity = (0, -GRAVITY, 0)
    n, count = s["n"], s["n"] ** 2
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    quads = np.stack([corner, corner + 1, corner + n + 1, corner + n], 1)
    quads = np.concatenate([quads + count * k for k in range(s["sheets"])])
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata(s["x"].tolist(), [], quads.tolist())
    cloth = bpy.data.objects.new("cloth", mesh)
    stage.collection.objects.link(cloth)
    modifier = cloth.modifiers.new("cloth", "CLOTH")
    own, contact = modifier.settings, modifier.collision_settings
    own.mass = s["density"] / count
    own.time_scale = 2 / FPS / np.sqrt(1e-3)  # 1.05: very nearly its own
    scale = 1e-3 / (n - 1)
    own.tension_stiffness = own.compression_stiffness = (s["stretch"] - s["shear"]) * scale
    own.shear_stiffness = s["shear"] * scale
    own.bending_stiffness = 10 * s["bend"]
    own.air_damping = 0
    own.tension_damping = own.compression_damping = own.shear_damping = own.bending_damping = 0
    contact.use_self_collision = True
    contact.self_distance_min = s["thickness"]
    contact.distance_min = s["thickness"] - 0.001
    contact.friction = contact.self_friction = 100 * s["friction"]
    if s["slope"]:
        plate = bpy.data.meshes.new("plate")
        points, triangles = plate_mesh(s["slope"])
        plate.from_pydata(points.tolist(), [], triangles.tolist())
        solid = bpy.data.objects.new("plate", plate)
        stage.collection.objects.link(solid)
        bpy.context.view_layer.objects.active = solid
    else:
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6, radius=s["radius"])
        solid = bpy.context.object
    solid.modifiers.new("collision", "COLLISION")
    solid.collision.thickness_outer = 0.001
    solid.collision.cloth_friction = 100 * s["friction"]
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 0, 100000
    stage.frame_set(0)

    def positions() -> np.ndarray:
        x = np.empty(3 * count * s["sheets"], dtype=np.float32)
        cloth.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices.foreach_get("co", x)
        return x.reshape(-1, 3).astype(float)

    return (lambda: stage.frame_set(stage.frame_current + 1), FPS // 2, positions,
            f"Blender {bpy.app.version_string}, quality {own.quality}")


def pypbd(s: dict) -> Run:
    """pyPBD: XPBD of distances and dihedral angles as in the table of errors, 20 substeps of one iteration; the ball as a
    distance field, a plate as one of a kilometre, tolerance the thickness, its own contact stiffness. Half of the friction for
    cloth and solid, since it adds them (measured on a slope). It has no contact of cloth with cloth."""
    import pypbd as pbd

    simulation = pbd.Simulation.getCurrent()
    simulation.initDefault()
    model, stepper = simulation.getModel(), simulation.getTimeStep()
    model.cleanup()
    detection = pbd.DistanceFieldCollisionDetection()
    stepper.setCollisionDetection(model, detection)
    detection.setTolerance(s["thickness"])
    radius = FAR if s["slope"] else s["radius"]
    points, triangles = ball_mesh(radius)
    middle = -radius * turn(s["slope"])[:, 1] if s["slope"] else np.zeros(3)
    ball = model.addRigidBody(1.0, *pbd_mesh(pbd, points, triangles), translation=middle, generateCollisionObject=False,
                              testMesh=False)
    ball.setMass(0.0)
    ball.setFrictionCoeff(s["friction"] / 2)
    vertices = ball.getGeometry().getVertexData()
    kinds = pbd.CollisionObject
    detection.addCollisionSphere(0, kinds.RigidBodyCollisionObjectType, vertices, 0, len(points), radius, False, False)
    n, particles = s["n"] ** 2, model.getParticles()
    for k in range(s["sheets"]):
        made = model.addTriangleModel(list(s["x"][n * k: n * k + n]), s["faces"].ravel().tolist(), testMesh=True)
        made.setFrictionCoeff(s["friction"] / 2)
        model.addClothConstraints(made, 4, s["stretch"], s["stretch"], s["shear"], s["shear"], 0.3, 0.3, False, False)
        model.addBendingConstraints(made, 3, s["bend"])
        detection.addCollisionObjectWithoutGeometry(k, kinds.TriangleModelCollisionObjectType, particles, n * k, n, True)
    total = n * s["sheets"]
    for i in range(total):
        particles.setMass(i, s["density"] / n)
    stepper.setValueUInt(pbd.TimeStepController.NUM_SUB_STEPS, 20)
    stepper.setValueUInt(pbd.TimeStepController.MAX_ITERATIONS, 1)
    pbd.TimeManager.getCurrent().setTimeStepSize(1 / FPS)
    kept = [detection]  # pyPBD does not keep it alive
    return (lambda: (stepper.step(model), kept), FPS, lambda: np.array([particles.getPosition(i) for i in range(total)]),
            f"pyPBD {version('pypbd')}, 20 x 1, no self-contact")


def vbd(s: dict) -> Run:
    """Newton's VBD, 10 substeps of its default 10 iterations: StVK with mu half the stretch and lambda 0, which carries the
    stretch and five times our shear; ke of bending is D / a, a the edge, damping 0. Radius of particles and self-contact
    margin are the thickness, soft_contact_ke that of its own twist example."""
    return newton(s, "VBD")


def style3d(s: dict) -> Run:
    """Newton's Style3D, 10 substeps of 4 iterations as in its own example: stretch and shear as they are, a third of D for
    its quadratic bending, damping 0. Its contact radius is half the thickness; self-contact has no friction."""
    return newton(s, "Style3D")


def newton(s: dict, name: str) -> Run:
    """One of Newton's solvers, on the CPU."""
    import newton as nt
    import warp as wp

    wp.config.quiet = True
    wp.set_device("cpu")
    builder = nt.ModelBuilder(up_axis=nt.Axis.Y)
    n = s["n"] ** 2
    flat = {"pos": wp.vec3(0.0), "rot": wp.quat_identity(), "vel": wp.vec3(0.0), "scale": 1.0, "density": s["density"],
            "indices": s["faces"].ravel().tolist(), "particle_radius": s["thickness"], "tri_kd": 0.0, "edge_kd": 0.0}
    for k in range(s["sheets"]):
        flat["vertices"] = [wp.vec3(*p) for p in s["x"][n * k: n * k + n]]
        if name == "VBD":
            builder.add_cloth_mesh(**flat, tri_ke=s["stretch"] / 2, tri_ka=0.0, edge_ke=s["bend"] * (s["n"] - 1))
        else:
            if not k:
                nt.solvers.SolverStyle3D.register_custom_attributes(builder)
            nt.solvers.style3d.add_cloth_mesh(builder, **flat, panel_verts=s["uv"].tolist(),
                                              tri_aniso_ke=wp.vec3(s["stretch"], s["stretch"], s["shear"]),
                                              edge_aniso_ke=wp.vec3(s["bend"] / 3))
    if s["slope"]:
        builder.add_shape_plane(plane=(*turn(s["slope"])[:, 1].tolist(), 0.0), body=-1)
    else:
        builder.add_shape_sphere(body=-1, radius=s["radius"])
    if name == "VBD":
        builder.color(include_bending=True)
    model = builder.finalize()
    model.set_gravity((0.0, -GRAVITY, 0.0))
    model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e3, 0.0, s["friction"]
    model.shape_material_mu.fill_(s["friction"])
    if name == "VBD":
        iterations, margin = 10, s["thickness"]
        solver = nt.solvers.SolverVBD(model, iterations=iterations, particle_enable_self_contact=True,
                                      particle_self_contact_margin=margin, particle_self_contact_gap=margin / 2)
    else:
        iterations = 4
        solver = nt.solvers.SolverStyle3D(model, config=nt.solvers.SolverStyle3D.Config(iterations=iterations))
        solver.collision.radius = s["thickness"] / 2
    states, control = [model.state(), model.state()], model.control()
    pipeline = nt.CollisionPipeline(model)
    contacts = pipeline.contacts()

    def frame() -> None:
        for _ in range(10):
            states[0].clear_forces()
            pipeline.collide(states[0], contacts)
            solver.step(states[0], states[1], control, contacts, 1 / FPS / 10)
            states.reverse()

    return (frame, FPS, lambda: states[0].particle_q.numpy().astype(float),
            f"Newton {version('newton')} {name}, 10 x {iterations}, Warp {version('warp-lang')}, CPU")


def turn(slope: float) -> np.ndarray:
    """(3, 3) turns what is level to a slope [rad] that falls along x."""
    c, s = np.cos(slope), np.sin(slope)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def plate_mesh(slope: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a plate, a slope through the origin."""
    points = SIDE / 2 * np.array([[-1.0, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
    return points @ turn(slope).T, np.array([[0, 1, 2], [0, 2, 3]])


def ball_mesh(radius: float, around: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a ball."""
    rows = around // 2 + 1
    a, b = np.meshgrid(np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, around, endpoint=False), indexing="ij")
    points = radius * np.stack([np.sin(a) * np.cos(b), -np.cos(a), np.sin(a) * np.sin(b)], axis=-1).reshape(-1, 3)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(rows - 1), np.arange(around), indexing="ij"))
    right = (j + 1) % around
    p, q, r, t = i * around + j, i * around + right, (i + 1) * around + right, (i + 1) * around + j
    triangles = np.concatenate([np.stack([p, r, q], 1), np.stack([p, t, r], 1)])
    return points, triangles


def pbd_mesh(pbd: object, points: np.ndarray, triangles: np.ndarray) -> tuple[object, object]:
    """Vertex data and indexed mesh of pyPBD's."""
    data, mesh = pbd.VertexData(), pbd.IndexedFaceMesh()  # type: ignore[attr-defined]
    mesh.initMesh(len(points), 3 * len(triangles), len(triangles))
    for p in points:
        data.addVertex(p)
    for t in triangles:
        mesh.addFace([int(i) for i in t])
    mesh.buildNeighbors()
    return data, mesh


def version(package: str) -> str:
    """Of an installed package."""
    from importlib.metadata import version as of

    return of(package)


SYSTEMS = {"Blender": blender, "pyPBD": pypbd, "Newton Style3D": style3d, "Newton VBD": vbd}


def timed(make: Callable[[dict], Run], first: dict, task: dict) -> dict:
    """Runs a scene that makes it compile, and then the task: `setup` [s] is all up to its first frame, `wall` [s] the rest,
    `cpu` [s] what all threads worked in that; positions at its end, and how far particles went in the frame that ends half
    way and in the last one, `frame` [s] each."""
    start = time.perf_counter()
    frame, fps, positions, _ = make(first)
    for _ in range(round(fps * first["until"])):
        frame()
    del frame, positions  # what it holds is free: else a second one compiles anew, in the time that is measured
    frame, fps, positions, about = make(task)
    positions()
    ready, worked = time.perf_counter(), time.process_time()
    seen, last = {}, round(fps * task["until"])
    for k in range(1, last + 1):
        frame()
        if k in (last // 2 - 1, last // 2, last - 1):
            seen[k] = positions()
    wall, cpu = time.perf_counter() - ready, time.process_time() - worked
    x = positions()
    return {"setup": ready - start, "wall": wall, "cpu": cpu, "about": about, "x": x, "frame": 1 / fps, "frames": last,
            "went": np.stack([seen.get(last // 2, x) - seen.get(last // 2 - 1, x), x - seen.get(last - 1, x)])}


def main(name: str, source: str, target: str) -> int:
    """Exit code."""
    with np.load(source) as file:
        plans = [{**json.loads(str(file[f"{k}_plan"])), **{part: file[f"{k}_{part}"] for part in ("x", "uv", "faces")}}
                 for k in ("first", "task")]
    try:
        np.savez(target, **timed(SYSTEMS[name], *plans))
    except ImportError as missing:
        print(missing, file=sys.stderr)
        return ABSENT
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
