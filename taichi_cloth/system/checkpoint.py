"""The state that steps change and a run goes on from, declared where it lives: checkpoints follow from the declarations. numpy
only.

A class names its attributes in `STATE`; each is one of

- a number, a truth value, a string or an array;
- a field of Taichi's;
- a dataclass of such, a tuple of arrays, or arrays by name;
- an object whose class names its own, or None.

Particles, and state of forces on them, are declared with `ParticleState.remember` and rolled back as well; state named
here changes only when a step is accepted.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ..backend.rows import read, write
from ..errors import SceneError

VERSION = 16  # of checkpoints' content
BEFORE = 11  # the oldest that is understood: it named neither the integrator nor forces, nor their stored energy
RENAMED = {"was": "least_before", "firmness": "adaptive_stiffness", "boost": "scale", "lips": "opened_seams",
           "foresight": "forcing_terms", "growth": "thickness_ramp", "debt": "accumulated_gain",
           "walked": "known_end"}  # by 14
PENETRATION = "contacts.solids.penetration"


class Checkpointed:
    """An object with a `STATE`."""

    STATE: tuple[str, ...] = ()

    def checkpoint(self) -> dict[str, np.ndarray]:
        """All of its state, as arrays by dotted names."""
        return {name: np.array(value) for part in self.STATE for name, value in _arrays(part, getattr(self, part))}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from the arrays of `checkpoint`.

        Raises:
            KeyError: something is not in it.
        """
        for part in self.STATE:
            old = getattr(self, part)
            new = _value(part, old, state)
            if new is not old:
                setattr(self, part, new)
        self.resumed()

    def resumed(self) -> None:
        """Works out values that follow from the state."""


def numbered(objects: Iterable[Any]) -> dict[str, Any]:
    """By the names of their classes, and how many of that name came before."""
    count: Counter[str] = Counter()
    out = {}
    for one in objects:
        name = type(one).__name__
        out[f"{name}.{count[name]}"] = one
        count[name] += 1
    return out


def understood(state: dict[str, np.ndarray], integrator: str, forces: Iterable[str]) -> dict[str, np.ndarray]:
    """A checkpoint as this version writes it.

    Args:
        integrator: that of the simulation that is to go on; forces: names of those of its forces that have a state.

    Raises:
        SceneError: it is of a version that is not understood, or does not say which force's a state is.
    """
    version, known = int(state.get("version", 0)), list(forces)
    if version == VERSION:
        return state
    if not BEFORE <= version < VERSION:
        raise SceneError(f"the checkpoint is of version {version}, and this taichi_cloth goes on from versions {BEFORE} to "
                         f"{VERSION}")
    state = {_now(key): array for key, array in state.items() if key != "contacts.foresight.mends"}  # 13 dropped it
    if "contacts.layers.kept.key" in state:  # 14 added friction, of pinched particles too
        pairs = len(state["contacts.layers.kept.key"])
        state = {"contacts.layers.kept.friction": np.zeros((pairs, 3)),
                 "contacts.layers.kept.slip": np.full(pairs, np.inf), **state}
    if "contacts.layers.adaptive_stiffness.scale" in state:  # by 15
        state = {"contacts.layers.shift.parts": np.zeros_like(state["contacts.layers.adaptive_stiffness.scale"]), **state}
    if "contacts.solids.pinches.accepted.index" in state:
        pinched = len(state["contacts.solids.pinches.accepted.index"])
        state = {"contacts.solids.pinches.accepted.friction": np.zeros((pinched, 3)),
                 "contacts.solids.pinches.order.key": np.zeros(0, dtype=np.int64),  # by 16
                 "contacts.solids.pinches.order.side": np.zeros(0), **state}
    spared = state.get(f"{PENETRATION}.spared")
    if spared is not None:  # and where cloth is looked for inside solids
        state = {f"{PENETRATION}.across": np.zeros(len(spared), dtype=bool), f"{PENETRATION}.sought": spared > 0, **state}
    if version > BEFORE:
        return {**state, "version": np.array(VERSION)}
    of_force = below("gas", state)
    if of_force and len(known) > 1:
        raise SceneError(f"the checkpoint is of version {BEFORE}, which kept the state of one force only, and this scene has "
                         f"{len(known)} with one: {', '.join(known)}")
    out = {key: array for key, array in state.items() if not key.startswith("gas.")}
    out |= {f"force.{known[0] if known else 'Gas.0'}.{key}": array for key, array in of_force.items()}
    ended = state.get("step.measured", np.array("null"))
    return {**out, "version": np.array(VERSION), "integrator": np.array(integrator), "felt": np.array(""),
            "step.last": ended, "step.dropped": np.array(0.0)}


def _now(key: str) -> str:
    """A name of an older version as it is now."""
    root, *rest = key.split(".")
    return ".".join([root, *(RENAMED.get(name, name) for name in rest)]) if root in ("contacts", "integrator") else key


def unknown(state: dict[str, np.ndarray], parts: dict[str, Any], besides: Iterable[str]) -> list[str]:
    """Names in a checkpoint that stand for nothing that these parts remember, nor for one of `besides`."""
    roots = [f"{name}.{attribute}" for name, part in parts.items() for attribute in part.STATE] + list(besides)
    return [key for key in state if not any(key == root or key.startswith(root + ".") for root in roots)]


def _arrays(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Parts of a value, by dotted names."""
    if value is None:
        return
    if isinstance(value, Checkpointed):
        yield from ((f"{name}.{key}", array) for key, array in value.checkpoint().items())
    elif hasattr(value, "to_numpy"):
        yield name, read(value)
    elif is_dataclass(value):
        for field in fields(value):
            yield from _arrays(f"{name}.{field.name}", getattr(value, field.name))
    elif isinstance(value, tuple):
        for k, part in enumerate(value):
            yield from _arrays(f"{name}.{k}", part)
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from _arrays(f"{name}.{key}", part)
    else:
        yield name, value


def _value(name: str, old: Any, state: dict[str, np.ndarray]) -> Any:
    """A value in the place of an old one: the same object where that can be filled."""
    if old is None:
        return None
    if isinstance(old, Checkpointed):
        old.resume(below(name, state))
    elif hasattr(old, "from_numpy"):
        write(old, state[name])
    elif is_dataclass(old):
        kind: Any = type(old)
        return kind(**{f.name: _value(f"{name}.{f.name}", getattr(old, f.name), state) for f in fields(old)})
    elif isinstance(old, tuple):
        return tuple(_value(f"{name}.{k}", part, state) for k, part in enumerate(old))
    elif isinstance(old, dict):
        return {key: array.copy() for key, array in below(name, state).items()}
    elif isinstance(old, np.ndarray):
        return state[name].copy()
    else:
        return type(old)(state[name])
    return old


def below(name: str, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values that a name's own names stand for."""
    return {key[len(name) + 1:]: array for key, array in state.items() if key.startswith(name + ".")}
