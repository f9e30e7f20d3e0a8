"""The nonlinear problem of an implicit step, and the one line-searched Newton method that solves it.

`newton` defines a problem and solves any. Problems: `stage` (of TR-BDF2), `euler` (backward Euler), and the
latter with contact, `solid_contact` and `layer_contact`. `system` is the linear system of each Newton step,
`energy` the test of energy that a backward Euler step has to pass.
"""
