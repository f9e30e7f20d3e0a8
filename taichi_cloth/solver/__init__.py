"""Solvers of the step's linear system."""
