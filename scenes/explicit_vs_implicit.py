"""The argument for implicit steps: explicit at its stability limit against one large implicit step."""

import time

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 0.4, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 8}
DENSITY = 0.2


def build(cells: int = 20, stretch: float = 20000.0) -> tc.Scene:
    """A sheet of 1 m x 1 m, held at its upper edge and dropped from horizontal.

    Args:
        cells: along its side.
        stretch: stiffness [N/m].
    """
    fabric = tc.Fabric(DENSITY, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(5e-5))
    scene = tc.Scene(view=tc.View(reach=0.3))
    cloth = scene.add_cloth(tc.grid(1.0, cells), fabric)
    scene.pin(cloth, "top")
    return scene


def explicit(sim: "tc.Simulation", h: float) -> "tuple[tc.Simulation, float]":
    """The same scene, explicit at a fixed step, and its wall time [s] without compiling."""
    other = tc.Simulation(sim.scene, h=h, arch=sim.runtime.arch, precision=sim.runtime.precision,
                          threads=sim.runtime.threads, integrator="verlet", adaptive=False)
    other.step(h)
    start = time.perf_counter()
    other.run(sim.time - h, fps=1 / (sim.time - h))
    return other, time.perf_counter() - start


def check(sim: "tc.Simulation"):
    """Below its limit the explicit run follows the same motion; above it, it blows up, and says so."""
    h = tc.Simulation(sim.scene, precision=sim.runtime.precision, threads=sim.runtime.threads, arch=sim.runtime.arch,
                      integrator="verlet").integrator.stable_step
    ratio = max(r.h for r in sim.log) / h
    yield f"the implicit step is {ratio:.0f} times the explicit limit of {h * 1e6:.0f} us", ratio > 10
    slow, seconds = explicit(sim, 0.9 * h)
    implicit_seconds = sum(r.seconds["total"] for r in sim.log[1:])
    rms = float(np.sqrt(np.mean(np.sum((slow.positions() - sim.positions()) ** 2, axis=1))))
    yield (f"explicit: {len(slow.log)} steps, {seconds:.2f} s; implicit: {len(sim.log)} steps, {implicit_seconds:.2f} s; "
           f"RMS difference {rms:.3f} m of 1 m"), rms < 0.25
    try:
        other, _ = explicit(sim, 2.5 * h)
        gone = max(r.stretch for r in other.log)
        yield f"at 2.5 times the limit stretch reaches {gone:.3g}", gone > 2
    except tc.SimulationError as error:
        yield f"at 2.5 times the limit it stops: {error}", error.reason == "NOT_FINITE"


if __name__ == "__main__":
    tc.run(build)
