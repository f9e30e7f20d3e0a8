"""Recorded runs, and uses of them afterwards."""
