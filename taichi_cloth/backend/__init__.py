"""Taichi or a fork of it, runtime, fields, the order of vertices in memory, threads. Nothing here knows of cloth."""
