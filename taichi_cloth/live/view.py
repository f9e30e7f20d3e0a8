"""A session with its page, until it is ended. The page starts first, then shows the scene, then Taichi is imported."""

from __future__ import annotations

import contextlib
import threading
import webbrowser
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .. import checks
from ..backend.interrupts import Asked, noted
from ..backend.timing import compiling
from ..errors import SceneError, shown
from ..options import Options
from ..scene.reading import only_described
from .link import Link
from .parameters import Parameter
from .server import HOST

if TYPE_CHECKING:
    from ..scene.scene import Scene
    from ..simulation import Simulation
    from .session import Session, Source

PATIENCE = 1.0  # s after Ctrl-C without a word
KEPT = 600  # steps of the log that a page reads, where the options do not say


class Made:
    """Scenes that are made anew, by a function of their parameters."""

    again = True

    def __init__(self, make: Callable[[dict[str, object]], Scene], options: Options, parameters: tuple[Parameter, ...] = ()
                 ) -> None:
        self.make, self.parameters = make, parameters
        self.options = replace(options, log=KEPT) if options.log == Options().log else options
        self._damped = False  # whether any of its scenes so far was

    def scene(self, settings: dict[str, object]) -> Scene:
        """See `Source`."""
        return self.make(settings)

    def simulation(self, scene: Scene) -> Simulation:
        """See `Source`; it can be pulled at. Once a fabric is damped, those without damping have the same kernels."""
        from ..simulation import Simulation
        from .hand import pullable

        self._damped |= any(fabric.damped for cloth in scene.cloths for fabric in cloth.fabrics)
        scene.damped |= self._damped
        with pullable(scene):
            return Simulation(scene, options=self.options)


class Given:
    """The one simulation that there is."""

    again = False
    parameters: tuple[Parameter, ...] = ()

    def __init__(self, sim: Simulation) -> None:
        self.sim = sim

    def scene(self, settings: dict[str, object]) -> Scene:
        """See `Source`."""
        return self.sim.scene

    def simulation(self, scene: Scene) -> Simulation:
        """See `Source`."""
        return self.sim


def view(what: Scene | Simulation, *, host: str = HOST, port: int | None = None, opens: bool = True, plays: bool = True,
         **options: Any) -> None:
    """Shows a scene or a simulation in the browser as it runs, until End is clicked there, or Ctrl-C.

    Cloth is pulled with the mouse. A simulation goes on from where it is, and stays where the page left it; it can be pulled
    at where its scene has soft attachments. A notebook shows the page below its cell.

    Args:
        host: from which the page can be reached; the usual one is this machine alone, "0.0.0.0" is every network.
        port: of the page; None takes the first that is free from 8080 on.
        opens: whether a browser is opened; plays: whether steps are made at once.
        options: of the simulation of a scene, as `Simulation` takes them.

    Raises:
        SceneError: an impossible value or an unknown name.
        OutputError: no viser, or a port that cannot be had.
    """
    only_described("tc.view")
    for name, value in (("opens", opens), ("plays", plays)):
        checks.flag(f"view: {name}", value)
    checks.instance("view: host", host, str)
    checks.maybe(port, checks.integer, "view: port", least=1, most=65535)
    source = _source(what, options)
    serve(lambda: source, "taichi_cloth", host, port, opens, plays)


def _source(what: object, options: dict[str, Any]) -> Source:
    """The page's source: a scene or a simulation."""
    from ..scene.scene import Scene

    if isinstance(what, Scene):
        return Made(lambda settings: what, Options.named(options))
    from ..simulation import Simulation

    if not isinstance(what, Simulation):
        raise SceneError(f"view: what = {shown(what)}: must be a Scene or a Simulation")
    if options:
        raise SceneError(f"view: {next(iter(options))}: a simulation's options are decided before it is made")
    what.checked_run(1.0, 1.0)  # it is open
    return Given(what)


def serve(make: Callable[[], Source], title: str, host: str, port: int | None, opens: bool, plays: bool,
          tells: Callable[[str], object] = print) -> None:
    """Shows a source's simulations. Ctrl-C is the usual end: it waits for the step, or for the kernel, that is being made.

    Args:
        make: gives the source, once the page is starting; tells: is called with the page's address.

    Raises:
        ClothError: see `view`; also any error of building the scene.
    """
    hint = threading.Timer(PATIENCE, lambda: tells("ends as soon as this is done; Ctrl-C again, at once"))
    hint.daemon = True
    with noted(hint.start) as asked, contextlib.suppress(KeyboardInterrupt):
        link = Link(host, port)
        try:
            from .session import Session
            from .teller import Teller

            teller = Teller(title, link.tell, tells)
            session = Session(make(), teller)
            session.watched = False  # until the page has a browser
            address = link.wait()
            teller(session)
            link.listen(session, teller)
            tells(f"{title} is shown at {address} (End there, or Ctrl-C here, ends it)")
            if opens:
                _open(address)
            tells("setting up ...")
            with _ended(session), compiling.told(lambda: _unless(asked, teller.building)):
                _unless(asked, lambda: session.begin(plays))
                while not (session.over or asked()):
                    session.turn()
        finally:
            hint.cancel()
            link.close()


def _unless(asked: Asked, goes_on: Callable[[], object]) -> None:
    """Goes on, unless the process was asked to end."""
    if asked():
        raise KeyboardInterrupt
    goes_on()


@contextlib.contextmanager
def _ended(session: Session) -> Iterator[None]:
    """The session is over after it."""
    try:
        yield
    finally:
        session.end()


def _open(address: str) -> None:
    """In a browser, or below a notebook's cell."""
    from rich.console import Console

    if Console().is_jupyter:
        from IPython.display import IFrame, display

        display(IFrame(address, "100%", 700))
    else:
        webbrowser.open(address)
