"""Cloth against solids and cloth: detection, and the response inside the solve. [BW98 §5, §6]

- `distance`: distance and normal of analytic shapes; `closest`: of points, edges and triangles; `heap`: a tree of boxes.
- `detection`: cloth vertices against analytic solids; `tree`, `mesh_detection`: against triangles, and the edges and
  corners of solids against the edges and faces of cloth; all swept over the step.
- `response`: which contacts hold, stick and slide, round by round of a step.
- `candidates`, `layer_detection`, `near`: cloth near cloth; `layers`, `pressing`: its repulsion and friction; `tangles`: what
  passes through already.
- `touch`: what they add to the linear system besides held directions.

A scene without solids and cloth that meets cloth imports none of it.
"""
