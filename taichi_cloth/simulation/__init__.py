"""A scene that runs, in three layers: its parts, queries, and how it goes on.

- `parts`: from a scene to fields, forces, an integrator and a stepper;
- `queries`: state, energies, forces, and the linear system at a state;
- `simulation`: steps, frames, changes between them, checkpoints.
"""

from .simulation import Simulation as Simulation
