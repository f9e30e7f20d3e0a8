"""Contact with solids and between layers of cloth: detection, and the response inside the solve. [BW98 §5, §6]

- `geometry`: closest points of points, edges and triangles; `pair_geometry`: of many pairs.
- `points`: points of contact, the terms of contacts in the linear system besides held directions, and the arithmetic of its
  rows.
- `contacts`: the interface of contact to a step: constrained particles, forces, convergence, checkpoints; `step_start`: where
  an attempt begins, and whether its first solve is likely to be the last.
- `solid/`: cloth against solids. Detection is over the step: `vertices` and `mesh` of vertices of cloth that meet analytic
  solids and triangles, `pair_detector` of edges and corners of solids that meet edges and faces of cloth. `query` runs those
  that a scene needs. `coulomb` is the law of friction, `balance` applies it from solve to solve, `active_set` holds the
  contacts that stick or press, `sliding` has the points of those that slide. `pairs` repels edges and corners; `penetration`
  and `room` say which particles are too deep.
- `cloth/`: cloth against cloth. `collision_mesh` has the particles, edges and faces that can collide; `broad_phase` and
  `narrow_phase` find near pairs; `barrier` is the law of repulsion; friction between layers is in `pair_kernels`, which
  linearises both; `contact_pairs` has the pairs they work on; `untangle` parts crossings; `springs` are the
  paper's, for comparison.

A scene without solids and cloth that meets cloth imports none of it.
"""
