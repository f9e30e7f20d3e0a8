"""Contact with solids and between layers of cloth: detection, and the response inside the solve. [BW98 §5, §6]

- `geometry`: closest points of points, edges and triangles; `pair_geometry`: of many pairs.
- `points`: points of contact, the terms of contacts in the linear system besides held directions, and the arithmetic of its
  rows.
- `contacts`: all this as a step sees it: the particles held in the next solve, whether it settled, forces, checkpoints;
  `step_start`: where an attempt begins, and how many solves it will hardly do with.
- `solid/`: cloth against solids. `vertices` and `mesh` detect, over the step, vertices of cloth that meet analytic solids
  and triangles, and edges and corners of solids that meet edges and faces of cloth; `query` runs those that a scene needs.
  `solid_contacts` decides which contacts hold (`active_set`), stick and slide (`sliding`: friction); `pairs` presses edges
  and corners; `penetration` and `room` say which particles are too deep.
- `cloth/`: cloth against cloth. `collision_mesh` has the particles, edges and faces that can collide; `broad_phase` and
  `narrow_phase` find near pairs; `barrier` is the law of repulsion; friction between layers is in `pair_kernels`, which
  linearises both; `contact_pairs` has the pairs they work on; `untangle` parts crossings; `springs` are the
  paper's, for comparison.

A scene without solids and cloth that meets cloth imports none of it.
"""
