"""Contact with solids and between layers of cloth: detection, and the response inside the solve. [BW98 §5, §6]

- `geometry`: closest points of points, edges and triangles; `pair_geometry`: of many pairs.
- `contact_force`: what contacts add to the linear system besides held directions; `points`: what it is made of, and the
  arithmetic of its rows.
- `contacts`: what a step sees of all this: what the next solve holds, whether it settled, forces, checkpoints; `step_start`:
  where an attempt begins.
- `solid/`: cloth against solids. `vertices` and `mesh` detect, over the step, vertices of cloth that meet analytic solids
  and triangles, and edges and corners of solids that meet edges and faces of cloth; `query` runs those that a scene needs.
  `solid_contacts` says what holds (`active_set`), sticks and slides (`sliding`: friction); `pairs` presses edges and corners;
  `penetration` and `room` say what is too deep.
- `cloth/`: cloth against cloth. `collision_mesh` is what can collide; `broad_phase` and
  `narrow_phase` find what is near; `barrier` is the law of repulsion; friction between layers is in `pair_kernels`, which
  linearises both; `contact_pairs` is what they work on; `untangle` parts what passes through already; `springs` are the
  paper's, for comparison.

A scene without solids and cloth that meets cloth imports none of it.
"""
