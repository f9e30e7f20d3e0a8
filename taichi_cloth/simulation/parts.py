"""The composition root: a scene becomes fields, forces, an integrator and a stepper."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from .. import checks
from ..backend import runtime, taichi_patches
from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.ordering import components
from ..errors import BackendError, SceneError
from ..forces import build_forces
from ..options import BY_NAME, EXPLICIT, H_MIN_FACTOR, MACHINE, USUAL, Options
from ..scene.cloth import Cloth
from ..scene.mesh import borders_of, open_note
from ..scene.scene import Scene
from ..scene.sewing import Seam
from ..solver.pcg import Solution
from ..step import integrators
from ..step.choice import SAFETY, choose
from ..step.prescribed import Prescribed
from ..step.records import Locator, StepRecord, Tally
from ..step.stepper import ADVICE, Control, Stepper
from ..system.assembler import Assembler
from ..system.elements import lumped_mass
from ..system.operator import ForceField, Operator, Probe
from ..system.quantities import collapsed, deformation
from ..system.state import ParticleState

P = TypeVar("P", bound="Parts")
OF_SCENE = ("gravity", "air")
ROUNDED = 100.0  # times a vertex's weight, from which rounding in f32 is told of
H, H_EXPLICIT = 1 / 60, 0.1  # s, where none is given; explicit methods need it only to look at their result


@ti.data_oriented
class Parts:
    """Parts of a simulation, and its life: from a scene to fields, until they are given back.

    Attributes: see `Simulation`.
    """

    def __init__(self, scene: Scene, h: float | None = None, *, options: Options | None = None, **named: Any) -> None:
        if not isinstance(scene, Scene) or not scene.cloths:
            raise SceneError("a simulation needs a Scene with at least one cloth")
        asked = Options() if options is None else checks.instance("options", options, Options)
        asked = Options.named({**vars(asked), **({} if h is None else {"h": h}), **named})
        bound, h = asked.h is not None, asked.h or H
        self.control = Control(h, asked.h_min or min(h, USUAL) / H_MIN_FACTOR, asked.adaptive, asked.stretch_limit)
        if asked.preconditioner == "auto" and asked.K == "paper":  # an indefinite matrix has indefinite levels
            asked = replace(asked, preconditioner="block_jacobi")
        self.options = asked
        self.scene, self.time, self._h = scene, 0.0, h
        kept = asked.log
        self.log: Any = [] if isinstance(kept, str) else deque(maxlen=kept)
        self.watchers: list[Callable[[StepRecord], object]] = []  # are told of every step
        self.recall(())
        self.runtime = runtime.start(*(getattr(asked, name) for name in MACHINE))
        self._generation, self._open = runtime.generation, True
        self.integrator_name = asked.integrator
        self._fields = Fields(self.runtime.exchange, self.runtime.debug, self.runtime.arch == "cpu")
        try:
            self._build(scene, h)
        except BaseException:
            self._fields.free()
            raise
        if self.integrator.system is None:
            self.integrator.subcycles = asked.adaptive
            if asked.adaptive and not bound and not self.integrator.time_dependent:
                self.control = replace(self.control, h_max=H_EXPLICIT)
        self.notes += [f"{c.name}: {note}" for c in scene.cloths for note in notes_of(c, scene.seams)]
        if self.runtime.precision == "f32":
            g = float(np.linalg.norm(scene.gravity))
            self.notes += [f"{c.name}: {note}" for c in scene.cloths for note in rounded(c, g)]
        self._note_collapsed(self.model.start_positions)
        self.stitch_failure = self._stitch_failure()
        self.locator = Locator(self.model, scene.cloths, scene.solids)
        self.stepper = Stepper(self.model, self.integrator, self.meter, self.control, self.locator, self.stitch_failure)
        self.prescribed = Prescribed(self.model, scene.script.copy(), self.force_terms, self.contacts)
        try:
            self._resolve_initial_overlap()
        except BaseException:
            self._fields.free()
            raise
        scene.followers.add(self)
        self._extra: list[Fields] = []  # made when first asked for
        self._force_field: ForceField | None = None
        self._probe: Probe | None = None
        self.solution: Solution | None = None
        self._made = True

    def __setattr__(self, name: str, value: object) -> None:
        """Refuses assignments without effect: to options of a simulation that is made, and to values of its scene."""
        if "_made" in self.__dict__ and (name in BY_NAME or name in OF_SCENE):
            where = f"scene.{name} = ..." if name in OF_SCENE else f"tc.Simulation(scene, {name}=...)"
            later = {"h": ", or step(h)", "air": ", or set_wind(...)"}.get(name, "")
            raise SceneError(f"{name}: is decided before a simulation is made: {where}{later}")
        super().__setattr__(name, value)

    def _build(self, scene: Scene, h: float) -> None:
        """Everything that lives in fields."""
        fields = self._fields
        self.model = ParticleState(fields, scene, self.runtime)
        self.notes = list(taichi_patches.NOTES)
        substep = self.options.substep
        self.force_terms = build_forces(fields, self.model, scene, self.options.K, substep and substep / SAFETY)
        self.notes += [note for force in self.force_terms for note in force.notes]
        if self.integrator_name == "auto":
            tolerance = self.options.tolerance
            self.integrator_name, why = choose(self.force_terms, scene, h, tolerance, self.control.adaptive)
            self.notes.append(f"integrator {self.integrator_name}: {why}")
        self.contacts = _contacts(fields, self.model, scene, h, not self.runtime.device, self.options)
        operator, forces = None, list(self.force_terms)
        if self.integrator_name not in EXPLICIT:
            forces += [self.contacts.force] if self.contacts else []
            operator = Operator(fields, self.model, forces)
        self.meter = Assembler(self.model, forces, self.runtime, operator)
        self.integrator = integrators.build(self.integrator_name, fields, self.model, self.force_terms, self.meter,
                                            self.options, self.runtime, scene, self.contacts)
        if self.integrator.system is not None:
            self.notes += self.integrator.system.notes
            self.integrator.system.notes = self.notes  # notes made during the run are among them
        if self.model.sewn is not None:
            self.model.sewn.notes = self.notes
        fields.allocate()

    def _resolve_initial_overlap(self) -> None:
        """Puts cloths with layers in order, and moves cloth apart that starts too near to solids or to itself; `notes` tell
        of it."""
        if self.contacts is None:
            return
        held = self.prescribed.held(0.0)
        fixed = np.zeros(0, dtype=np.int64) if held is None else held.index
        if len({c.contact.layer for c in self.scene.cloths if c.contact is not None}) > 1:
            from ..contact.layer_order import put_in_order

            self.notes += [str(out) for out in put_in_order(self.contacts.detector, self.model, self.scene, fixed)]
            self.prescribed.begin_anew()
        if self.contacts.layers is not None:
            self._lay_on(fixed)
        self.notes += self.contacts.inspect()
        detector = self.contacts.detector
        if len(detector.inside.particles) or len(detector.crossed):
            from .starts import find

            self._starts = list(find(self.scene, self.model, detector))
            self.notes += map(str, self._starts)
            self.stepper.advise = self._advice
        if self.scene.hung:
            from .starts import refuse_inside, refuse_through

            refuse_inside(self.scene.hung, self.model, detector, self.scene.solids)
            refuse_through(self.scene.hung, self.scene.solids)
        moved = self.contacts.settle(fixed)
        if not len(moved.near):
            return
        self.prescribed.begin_anew()
        name = self.locator.name
        self.notes.append(f"{len(moved.near)} vertices start much nearer to solids, or to cloth, than they should be: cloth "
                          f"was moved apart, furthest {name(moved.particle)}, by {moved.by:.2g} m")
        if len(moved.left):
            self.notes.append(f"{len(moved.left)} vertices could not be moved apart, the first of them {name(moved.left[0])}")

    def _lay_on(self, fixed: np.ndarray) -> None:
        """Gives cloths that start in one place an order, that of the scene."""
        from ..contact.settle import lay_on

        moved = lay_on(self.model, self.contacts.layers, self.scene.cloths, fixed)
        if len(moved):
            self.prescribed.begin_anew()
            user = self.model.user[moved]
            names = " and ".join(repr(c.name) for c in self.scene.cloths
                                 if ((user >= c.start) & (user < c.start + c.mesh.vertex_count)).any())
            self.notes.append(f"{names}: {len(moved)} vertices start in one place with another cloth. They were moved along "
                              "their normals, to lie on it (which of the two does is by `layer`, or the scene's order)")

    def _advice(self, rejection: str) -> str:
        """The remedy where a run gives up: another start, while cloth that started in a solid is not out of it."""
        assert self.contacts is not None
        held = self.contacts.solids.penetration.spared > 0
        held[self.contacts.detector.find_crossings()] = True
        start = next((s for s in self._starts if held[s.particles].any()), None)
        return ADVICE[rejection] if start is None else f"The start is the likely cause. {start.told}: {start.move}"

    def _stitch_failure(self):
        """Stitches that can open, where anything is sewn; nothing of it is imported without."""
        if self.model.sewn is None:
            return None
        from ..system.stitches import Stitches
        from ..tearing.stitch_failure import StitchFailure

        stitches = Stitches(self.model.sewn, self.scene, self.force_terms)
        tears = None
        if any(c.split is not None for c in self.scene.cloths):
            from ..tearing.tears import Tears

            tears = Tears(self.scene, stitches, self.force_terms)
        return StitchFailure(stitches, self.integrator, self.meter, self.contacts, tears)

    def __enter__(self: P) -> P:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the fields back; the simulation is over. `with Simulation(...) as sim:` does so at its end.

        Some of their memory is kept for the next simulation, which need not compile kernels that read the same fields.
        """
        if self.is_open:
            for fields in (self._fields, *self._extra):
                fields.free()
        self._open = False
        self.scene.followers.discard(self)

    @property
    def is_open(self) -> bool:
        """Whether it can go on: it was not closed, nor ended by one of another arch, precision or number of threads."""
        return self._open and self._generation == runtime.generation

    def recall(self, records: Sequence[StepRecord]) -> None:
        """The log and the tally are those of earlier steps that this simulation goes on from."""
        records = [checks.instance("recall: record", record, StepRecord)
                   for record in (records if checks.is_sequence(records) else [records])]
        self.log.clear()
        self.log.extend(records)
        self.tally = Tally.of(records)
        self.last = records[-1] if records else None

    def count_on(self, other: "Parts") -> None:
        """The log and the tally are those of a simulation that this one takes the place of."""
        records = list(checks.instance("count_on: other", other, Parts).log)
        self.log.clear()
        self.log.extend(records)
        self.tally, self.last = other.tally, other.last

    def _made_step(self, record: StepRecord) -> None:
        """A step was made."""
        self.log.append(record)
        self.tally.add(record)
        self.last = record
        for watcher in self.watchers:
            watcher(record)

    def _later(self, kind, *args):
        """An object with fields of its own, for features that few runs ask for."""
        fields = Fields(self.runtime.exchange, self.runtime.debug, self.runtime.arch == "cpu")
        made = kind(fields, self.model, self.force_terms, *args)
        fields.allocate()
        self._extra.append(fields)
        return made

    def _live(self: P) -> P:
        if not self._open:
            raise BackendError("this simulation was closed")
        if self._generation != runtime.generation:
            raise BackendError("this simulation ended when another was started with a different arch, precision or "
                               "number of threads: use one of them at a time")
        return self

    def _note_collapsed(self, x: np.ndarray) -> None:
        """Says which cloth at positions x (n, 3) [m] has triangles without a width."""
        for cloth in self.scene.cloths:
            mesh = cloth.mesh
            count = collapsed(deformation(x[cloth.start:], mesh.faces, mesh.corner_uv))
            note = (f"{cloth.name}: {count} of {mesh.face_count} triangles are collapsed to a line or a point: no force has "
                    "a side to open them to, so they may stay so; give them some width")
            if count and note not in self.notes:
                self.notes.append(note)


def notes_of(cloth: Cloth, seams: Iterable[Seam]) -> tuple[str, ...]:
    """Notes of a cloth's mesh; borders that lie on each other count as open only if they are not sewn."""
    seams, mesh, whole = [s for s in seams if s.cloth is cloth], cloth.mesh, cloth.whole
    if all(s.tears for s in seams):
        return mesh.notes
    unsewn = open_note(whole.x, borders_of(whole.faces))
    joined = components(mesh.vertex_count, *(np.concatenate([getattr(s, side) for s in seams]) for side in "ab"))
    return (*(note for note in mesh.notes if note not in unsewn), *open_note(mesh.x, borders_of(mesh.faces), joined))


def rounded(cloth: Cloth, g: float) -> tuple[str, ...]:
    """A note on a cloth whose stretch, as f32 rounds it, pulls by many times its vertices' weight at g [m/s^2]."""
    stiffness = [f.stretch.k for f in cloth.fabrics if f.stretch is not None and f.stretch.k is not None]
    k = max((float(np.max(k)) for k in stiffness), default=0.0)
    noise = k * float(np.ptp(cloth.positions, axis=0).max(initial=0.0)) * float(np.finfo(np.float32).eps)  # N
    weight = g * float(np.median(lumped_mass(cloth.mesh, cloth.density)))
    if noise <= ROUNDED * weight or not weight:
        return ()
    return (f"f32 rounds its stretch by forces of {noise:.2g} N, and a vertex weighs {weight:.2g} N: it may hang in the air; "
            "use f64",)


def _contacts(fields: Fields, model: ParticleState, scene: Scene, h: float, cpu: bool, options: Options):
    """The contacts of a scene with solids, or with cloth that meets cloth; nothing of them is imported without."""
    if not scene.touches:
        return None
    from ..contact.contacts import Contacts

    return Contacts(fields, model, scene, h, cpu, options.tangles, options.contact)
