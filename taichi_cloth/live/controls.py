"""Buttons, sliders and words beside the cloth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..output.look import Heat
from .parameters import Parameter
from .session import Session

LOOK = "the look"  # in place of a heat map
GALE = 20.0  # m/s: the most that a slider adds to the wind


class Controls:
    """Everything beside the picture; each of them puts a call into the session's orders.

    Args:
        gui: of a viser server.
    """

    def __init__(self, gui: Any, session: Session) -> None:
        self.gui, self.session = gui, session
        self.state = gui.add_markdown("")
        self._run()
        if session.source.parameters:
            with gui.add_folder("Parameters"):
                for parameter in session.source.parameters:
                    self._parameter(parameter)
        if session.scene.air is not None:
            with gui.add_folder("Wind added [m/s]", expand_by_default=not session.source.parameters):
                self.wind = [gui.add_slider(axis, -GALE, GALE, 0.1, 0.0) for axis in "xyz"]
            for slider in self.wind:
                self._when(slider.on_update, lambda: session.blow(np.array([s.value for s in self.wind])), "wind")
        with gui.add_folder("Colours"):
            self.heat = gui.add_dropdown("by", (LOOK,), initial_value=LOOK)
            self.wire = gui.add_checkbox("edges", False)
            self.bar = gui.add_image(np.zeros((12, 256, 3), dtype=np.uint8), visible=False)
            self.ends = gui.add_markdown("", visible=False)
        self._when(self.heat.on_update, lambda: session.color_by("" if self.heat.value == LOOK else self.heat.value), "heat")
        self._when(self.wire.on_update, lambda: None, "wire")
        with gui.add_folder("Last step"):
            self.last = gui.add_markdown("")
        with gui.add_folder("Costly steps", expand_by_default=False):
            self.costly = gui.add_markdown("")

    def _run(self) -> None:
        """Play, pause, step, and the like."""
        gui, session = self.gui, self.session
        self.plays = gui.add_button("Play")
        self._when(self.plays.on_click, lambda: session.pause() if session.running else session.play(), "run")
        self._when(gui.add_button("Step").on_click, session.step)
        if session.source.again:
            self._when(gui.add_button("Reset").on_click, session.reset, "reset")
        self._when(gui.add_button("End").on_click, session.finish)

    def _parameter(self, p: Parameter) -> None:
        """A control that fits its type."""
        gui = self.gui
        if isinstance(p.value, bool):
            made = gui.add_checkbox(p.name, p.value)
        elif isinstance(p.value, str):
            made = gui.add_text(p.name, p.value)
        elif p.range is None:
            made = gui.add_number(p.name, p.value)
        else:
            made = gui.add_slider(p.name, *p.range, p.step, p.value)
        self._when(made.on_update, lambda: self.session.set(p.name, type(p.value)(made.value)), f"set {p.name}")

    def _when(self, register: Callable, call: Callable[[], object], key: str = "") -> None:
        """A person's change becomes an order; one that the program made does not."""

        async def ask(event: Any) -> None:  # in the server's own thread, where events keep their order
            if event.client is not None:
                self.session.orders.put(call, key)

        register(ask)

    def offer(self, heats: list[str]) -> None:
        """The heat maps that there are."""
        options = (LOOK, *heats)
        if tuple(self.heat.options) != options:
            chosen = self.heat.value
            self.heat.options = options
            self.heat.value = chosen if chosen in options else LOOK

    def say(self, line: str, runs: bool) -> None:
        """The state, in a line."""
        self.state.content, self.plays.label = line, "Pause" if runs else "Play"

    def tell(self, last: str, costly: str) -> None:
        """What steps did."""
        self.last.content, self.costly.content = last, costly.replace("\n", "\n\n")

    def scale(self, heat: Heat | None, colors: np.ndarray | None) -> None:
        """A heat map's colours, with the values at their ends."""
        self.bar.visible = self.ends.visible = heat is not None
        if heat is not None:
            self.bar.image = colors
            unit = f" {heat.unit}" if heat.unit else ""
            self.ends.content = f"{heat.range[0]:.3g} to {heat.range[1]:.3g}{unit}"
