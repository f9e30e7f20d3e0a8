"""Kinetic and potential energy of a simulation's cloths, from positions and velocities alone."""

import numpy as np

from .rest import angles, hinges, pair

CREST, COLLAPSED = 0.2, 0.1  # rad; part of the smaller triangle


def energies(sim) -> tuple[float, float]:
    """(kinetic, potential) [J]: stretch, shear, hinges and gravity."""
    x, v = sim.positions(), sim.velocities()
    kinetic = potential = 0.0
    for cloth in sim.scene.cloths:
        mine = slice(cloth.start, cloth.start + len(cloth.mesh.x))
        mass, stored = _stored(cloth.mesh, cloth.fabric, x[mine])
        kinetic += np.sum(mass * np.sum(v[mine] ** 2, axis=1)) / 2
        potential += stored - np.sum(mass * (x[mine] @ sim.scene.gravity))
    return float(kinetic), float(potential)


def _stored(mesh, fabric, x: np.ndarray) -> tuple[np.ndarray, float]:
    """(masses (n,) [kg], elastic energy [J])"""
    p = mesh.corner_uv
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    whole = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = np.abs(whole) / 2
    mass = np.bincount(mesh.faces.ravel(), np.repeat(fabric.density * area / 3, 3), minlength=len(x))
    e, f = x[mesh.faces[:, 1]] - x[mesh.faces[:, 0]], x[mesh.faces[:, 2]] - x[mesh.faces[:, 0]]
    w_u = (e * b[:, 1:] - f * a[:, 1:]) / whole[:, None]
    w_v = (f * a[:, :1] - e * b[:, :1]) / whole[:, None]
    k_u, k_v = pair(fabric.stretch.k)
    total = np.sum(area / 2 * (k_u * (np.linalg.norm(w_u, axis=1) - 1) ** 2 + k_v * (np.linalg.norm(w_v, axis=1) - 1) ** 2
                               + fabric.shear.k * np.einsum("mi,mi->m", w_u, w_v) ** 2))
    if fabric.bend is not None:
        total += fabric.bend.D / 2 * _bent(hinges(mesh), x)
    return mass, float(total)


def _bent(rest: list[dict], x: np.ndarray) -> float:
    """Sum of squared conditions of hinges that are flat at rest, weighted."""
    corner = x[np.array([h["vertices"] for h in rest])]
    e, arms = corner[:, 1] - corner[:, 0], (corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 0])
    normals = np.cross(e, arms[0]), np.cross(arms[1], e)
    angle = np.abs(angles(corner))
    left = np.pi - angle
    angle = np.where(left < CREST, np.pi - CREST / 2 - left**2 / (2 * CREST), angle)  # level where a fold closes
    for n in normals:  # and nothing where a triangle collapses
        part = np.minimum(np.linalg.norm(n, axis=1) / 2 / (COLLAPSED * np.array([h["least"] for h in rest])), 1.0)
        angle = angle * part * (2 - part)
    return float(np.sum(np.array([h["weight"] for h in rest]) * angle**2))
