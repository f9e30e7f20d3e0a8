"""Buttons, sliders and words beside the cloth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import ClothError
from ..scene.every import known
from .counting import Counting
from .orders import named
from .parameters import Parameter
from .seen import Opening, Seen

SETTING_UP, BUILDING = "setting up", "loading or compiling kernels"  # states
SHORT = 0.3  # s of the latter that are not worth telling
LOOK = "the look"  # in place of a heat map
GALE = 20.0  # m/s: the most that a slider adds to the wind


class Controls:
    """The controls beside the picture; each change that a person makes becomes an order of the session.

    Args:
        gui: of a viser server.
        ask: takes the name of an order, its values, and a key; see `page.Ask`.
    """

    def __init__(self, gui: Any, opened: Opening, ask: Callable[[str, tuple, str], object]) -> None:
        self.gui, self.ask, self.running = gui, ask, False
        said, self.change = gui.add_markdown(""), gui.add_markdown("", visible=False)
        self.state, self.changes = Counting(lambda text: setattr(said, "content", text)), 0
        self._run(opened.again)
        if opened.parameters:
            with gui.add_folder("Parameters"):
                for parameter in opened.parameters:
                    self._parameter(parameter)
        if opened.airy:
            with gui.add_folder("Wind added [m/s]", expand_by_default=not opened.parameters):
                self.wind = [gui.add_slider(axis, -GALE, GALE, 0.1, 0.0) for axis in "xyz"]
            for slider in self.wind:
                self._when(slider.on_update, lambda: ("blow", np.array([s.value for s in self.wind])), "wind")
        with gui.add_folder("Colours"):
            self.heat = gui.add_dropdown("by", (LOOK,), initial_value=LOOK)
            self.wire = gui.add_checkbox("edges", False)
            self.bar = gui.add_image(np.zeros((12, 256, 3), dtype=np.uint8), visible=False)
            self.ends = gui.add_markdown("", visible=False)
        self._when(self.heat.on_update, lambda: ("color_by", "" if self.heat.value == LOOK else self.heat.value), "heat")
        self._when(self.wire.on_update, lambda: ("look",), "look")
        with gui.add_folder("Last step"):
            self.last = gui.add_markdown("")
        with gui.add_folder("Costly steps", expand_by_default=False):
            self.costly = gui.add_markdown("")

    def show(self, seen: Seen) -> None:
        """Shows the state of the session in words, and the colours' scale."""
        self.running = seen.running
        self.plays.label = "Pause" if seen.running else "Play"
        if seen.preview:
            self.state.count(SETTING_UP)
        else:
            self.state.show(seen.state)
        if seen.changes != self.changes:
            self.changes = seen.changes
            self._tell(seen.change)
        if seen.heats is not None:
            self._offer((LOOK, *seen.heats))
        self.bar.visible = self.ends.visible = seen.heat is not None
        if seen.heat is not None and self.ends.content != seen.heat.text:
            self.bar.image, self.ends.content = seen.heat.bar, seen.heat.text
        if seen.last is not None:
            self.last.content = seen.last
        if seen.costly is not None:
            self.costly.content = seen.costly.replace("\n", "\n\n")

    def _run(self, again: bool) -> None:
        """Play, pause, step, and the like."""
        self.plays = self.gui.add_button("Play")
        self._when(self.plays.on_click, lambda: ("pause" if self.running else "play",), "run")
        self._when(self.gui.add_button("Step").on_click, lambda: ("step",))
        if again:
            self._when(self.gui.add_button("Reset").on_click, lambda: ("reset",), "reset")
        self._when(self.gui.add_button("End").on_click, lambda: ("finish",))

    def _parameter(self, p: Parameter) -> None:
        """A control that fits its type."""
        gui, hint = self.gui, p.meaning or None
        if isinstance(p.value, bool):
            made = gui.add_checkbox(p.name, p.value, hint=hint)
        elif isinstance(p.value, str):
            made = gui.add_text(p.name, p.value, hint=hint)
        elif p.range is None:
            made = gui.add_number(p.name, p.value, hint=hint)
        else:
            made = gui.add_slider(p.name, *p.range, p.step, p.value, hint=hint)
        self._when(made.on_update, lambda: ("set", p.name, type(p.value)(made.value)), f"set {p.name}",
                   known if p.every else None)

    def _when(self, register: Callable, wish: Callable[[], tuple], key: str = "", check: Callable | None = None) -> None:
        """A person's change is asked for, unless a check refuses it; one that the program made is not."""

        async def changed(event: Any) -> None:  # in the server's own thread, where events keep their order
            if event.client is not None:
                name, *values = wish()
                said = named(name, tuple(values))
                try:
                    if check is not None:
                        check(*values)
                except ClothError as error:  # here, as the session may be building kernels
                    self._tell(f"{said}: not possible: {error}")
                    return
                if said:
                    self._tell(f"{said} ...")
                self.ask(name, tuple(values), key)

        register(changed)

    def _tell(self, change: str) -> None:
        """Shows a change in words: at once as it is asked for, then from when on it holds."""
        self.change.content, self.change.visible = change, True

    def _offer(self, options: tuple[str, ...]) -> None:
        """The heat maps that there are."""
        if tuple(self.heat.options) != options:
            chosen = self.heat.value
            self.heat.options = options
            self.heat.value = chosen if chosen in options else LOOK
