"""Seams that rip and cloth that tears: which stitches are overloaded in a step, and where the mesh is opened."""
