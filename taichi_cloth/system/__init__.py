"""A cloth's particles and elements in fields, and the linear system that a step solves, eq. (18)."""
