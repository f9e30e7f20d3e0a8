"""Fabric parameters from measurements: a model of the experiment, fitted by least squares, with its uncertainty.

- `data`: measurements from a CSV file or arrays, checked;
- `closed_forms`: cantilever (elastica) and strip (tension against strain);
- `simulated`: drape and swing, which are simulated over a range of values, as a sweep;
- `least_squares`: parameters, covariance, intervals and the band of the curve;
- `fit`: all of it together.
"""
