"""What steps change and a run goes on from, declared where it lives: checkpoints follow from the declarations. numpy only.

A class names its attributes in `STATE`; each is one of

- a number, a truth value, a string or an array;
- a field of Taichi's;
- a dataclass of such, a tuple of arrays, or arrays by name;
- an object whose class names its own, or None.

Particles and what forces add to them are declared with `ParticleState.remember` and rolled back as well; what is named
here changes only when a step is accepted.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ..backend.rows import read, write

VERSION = 11  # of what checkpoints hold


class Checkpointed:
    """An object with a `STATE`."""

    STATE: tuple[str, ...] = ()

    def checkpoint(self) -> dict[str, np.ndarray]:
        """All of its state, as arrays by dotted names."""
        return {name: np.array(value) for part in self.STATE for name, value in _arrays(part, getattr(self, part))}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from what `checkpoint` gave.

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
        """Works out what follows from the state."""


def _arrays(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """What a value consists of, by dotted names."""
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
    """What takes the place of an old value: the same object where that can be filled."""
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
    """What a name's own names stand for."""
    return {key[len(name) + 1:]: array for key, array in state.items() if key.startswith(name + ".")}
