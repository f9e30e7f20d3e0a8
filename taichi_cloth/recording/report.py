"""One self-contained HTML page about a recorded run: how complex, how often it went wrong, how real it looks."""

import base64
import html
import json
import pathlib
import string

import numpy as np

from ..backend import runtime
from ..errors import OutputError
from ..output.facing import facing
from ..output.folder import write_whole
from ..output.look import Look
from ..output.picture import Artist, contact_sheet, surfaces
from ..output.plot import line_plot
from ..output.png import encode_png
from ..output.recording import Recording
from ..step.records import StepRecord, Tally
from .accounts import SIGN, change, changes
from .drawing import frames_of
from .playback import spread
from .why import costliest

BUDGET = 12e6  # bytes of positions that the page may hold
PARTS = ("EVAL", "CG", "C-C", "C-S")
THUMBNAIL, PICTURES = (360, 240), 9
DEAREST = 5  # steps


def write_report(recording: Recording, file: pathlib.Path) -> None:
    """Writes the page.

    Raises:
        OutputError: the run has no steps or no frames.
    """
    log = recording.telemetry()
    if not log:
        raise OutputError(f"{recording.path} has no telemetry: nothing was simulated")
    m = recording.manifest
    tally = Tally.of(StepRecord(**r) for r in log)
    parts = [_complexity(recording, log), _trouble(tally), _energy(tally), _cost(m, log), _most(recording), _plots(log),
             _pictures(recording)]
    ran = m["runtime"]
    subtitle = (f"{m['simulation']['integrator']}, {ran['arch']} {ran['precision']}, {ran['threads']} threads, "
                f"taichi_cloth {m['taichi_cloth']}, started {m['started']}; {m['status']}")
    write_whole(file, page(recording, f"{m['scene']}: {log[-1]['t']:g} s of cloth", subtitle, "\n".join(parts)).encode())


def page(recording: Recording, title: str, subtitle: str, body: str, budget: float = BUDGET) -> str:
    """The text of a page that plays a run, after a body of HTML.

    Args:
        budget: bytes of positions that it may hold; frames are left out where all would be more.

    Raises:
        OutputError: the run has no frames, or a damaged one.
    """
    data, note = _playback(recording, budget)
    template = pathlib.Path(__file__).parents[1] / "output" / "report_template.html"
    return string.Template(template.read_text(encoding="utf-8")).substitute(
        title=html.escape(title), body=body, subtitle=html.escape(subtitle), data=json.dumps(data), note=html.escape(note))


def _complexity(recording: Recording, log: list[dict]) -> str:
    g, m = recording.geometry, recording.manifest
    most = max((r.get("contacts", 0) for r in log), default=0)
    rows = [("vertices", f"{m['model']['vertices']:,}"), ("triangles", f"{m['model']['triangles']:,}"),
            ("hinges", f"{len(g['hinges']):,}"), ("solids", str(m["model"].get("solids", 0))),
            ("most contacts in a step", f"{most:,}"),
            ("options", ", ".join(f"{k} = {v}" for k, v in m["settings"].items()) or "none")]
    notes = "".join(f"<li>{html.escape(n)}</li>" for n in m["model"].get("notes", []))
    return "<h2>How complex is it?</h2>" + _table([("model", ""), *rows]) + (f"<ul>{notes}</ul>" if notes else "")


def _trouble(t: Tally) -> str:
    rejected = ", ".join(f"{name} {count}" for name, count in t.rejections.items()) or "none"
    rows = [("steps", f"{t.steps:,}"), ("rejected", rejected),
            ("smallest and largest h", f"{1e3 * (t.smallest_h or 0.0):.3g} ms, {1e3 * (t.largest_h or 0.0):.3g} ms"),
            ("worst residual of a solve", f"{t.residual:.2g}"), ("solves not converged", str(t.not_converged)),
            ("crossings with solids, most in a step", str(t.solid_intersections)),
            ("crossings of cloth with cloth, most in a step", str(t.known_intersections)),
            ("pairs of cloth in contact, most in a step", str(t.layers)),
            ("smallest gap between layers [thicknesses]", f"{t.min_gap_ratio:.2f}"), ("largest stretch", f"{t.stretch:.4f}")]
    return "<h2>How often did it go wrong?</h2>" + _table([("step control", ""), *rows])


def _energy(t: Tally) -> str:
    ledger = t.ledger
    rows = [(name, f"{value:+.4g}") for name, value in changes(ledger).items()]
    rows += [("unaccounted for", f"{ledger['unaccounted']:+.4g}"), ("change in all", f"{change(ledger):+.4g}"),
             ("of it kinetic", f"{ledger['kinetic']:+.4g}"), ("of it potential", f"{ledger['potential']:+.4g}")]
    rows += [("unaccounted for, most in a step", f"{t.worst:.4g}"), ("moved from one account to another", f"{t.moved:.4g}")]
    said = t.doubt()
    note = f"<p>{html.escape(said)}</p>" if said else ""
    return "<h2>Where did the energy go?</h2>" + _table([(f"energy of the cloth, over all steps ({SIGN})", "J"), *rows]) + note


def _cost(manifest: dict, log: list[dict]) -> str:
    total = sum(r["seconds"].get("total", 0.0) for r in log)
    rows = [("part of the steps [BW98, table 1]", "s", "ms a step", "share")]
    sums = {part: sum(r["seconds"].get(part, 0.0) for r in log) for part in PARTS}
    for part, spent in {**sums, "other": max(total - sum(sums.values()), 0.0), "total": total}.items():
        rows.append((part, f"{spent:.2f}", f"{1e3 * spent / len(log):.2f}", f"{spent / max(total, 1e-12):.1%}"))
    for part, spent in manifest.get("output_seconds", {}).items():
        rows.append((f"{part} (not in total)", f"{spent:.2f}", f"{1e3 * spent / len(log):.2f}", ""))
    simulated = log[-1]["t"]
    return (f"<h2>What did it cost?</h2><p>{total / max(simulated, 1e-12):.2f} s of steps per simulated second, "
            f"{sum(r['iterations'] for r in log):,} CG iterations in {sum(r['solves'] for r in log):,} solves.</p>"
            + _table(rows))


def _most(recording: Recording) -> str:
    return f"<h2>What cost the most?</h2><pre>{html.escape(costliest(recording, DEAREST))}</pre>"


def _plots(log: list[dict]) -> str:
    t = np.array([r["t"] for r in log])

    def of(key: str) -> np.ndarray:
        return np.array([float(r.get(key, 0)) for r in log])

    energies = {name: (t, np.array([r["energies"].get(name, 0.0) for r in log])) for name in log[-1]["energies"]}
    figures = {"step size h [ms]": line_plot({"h": (t, 1e3 * of("h"))}, "t [s]"),
               "CG iterations a step": line_plot({"iterations": (t, of("iterations"))}, "t [s]"),
               "energy [J] by term": line_plot(energies, "t [s]"),
               "energy unaccounted for, in all [J]": line_plot({"unaccounted": (t, np.cumsum(
                   [r.get("ledger", {}).get("unaccounted", 0.0) for r in log]))}, "t [s]"),
               "largest stretch |w|/b": line_plot({"stretch": (t, of("stretch"))}, "t [s]"),
               "contacts with solids": line_plot({k: (t, of(k)) for k in ("contacts", "unconverged_contacts")}, "t [s]")}
    parts = [f"<figure>{svg}<figcaption>{html.escape(name)}</figcaption></figure>" for name, svg in figures.items()]
    return '<h2>How did it go?</h2><div class="plots">' + "".join(parts) + "</div>"


def _pictures(recording: Recording) -> str:
    runtime.go_on()
    numbers = spread(recording.frames(), PICTURES)
    artist = Artist(recording.geometry, THUMBNAIL, Look(quality="standard", caption="t = {t} s"),
                    lambda: frames_of(recording))
    sheet = contact_sheet([artist.draw(recording.frame(k), k) for k in numbers], 3)
    text = base64.b64encode(encode_png(sheet, 6)).decode()
    return f'<h2>How real does it look?</h2><img alt="frames of the run" src="data:image/png;base64,{text}">'


def _playback(recording: Recording, budget: float) -> tuple[dict, str]:
    """Positions as 16-bit numbers within the run's bounds, by frame, and a sentence on the left-out ones."""
    g, numbers = recording.geometry, recording.frames()
    moves = "solid_x" in recording.frame(numbers[0])
    each = 6 * (len(g["x"]) + (len(g["solid_x"]) if moves else 0))
    every = max(1, int(np.ceil(each * len(numbers) / budget)))
    kept = numbers[::every]
    frames = [recording.frame(k) for k in kept]
    solids = [f["solid_x"] for f in frames] if moves else [g["solid_x"]]
    everything = np.concatenate([f["x"] for f in frames] + solids).astype(np.float64)
    low, span = everything.min(axis=0), np.maximum(np.ptp(everything, axis=0), 1e-9)

    def packed(x: np.ndarray) -> str:
        return base64.b64encode(np.rint((x - low) / span * 65535).astype("<u2").tobytes()).decode()

    def indices(faces: np.ndarray) -> str:
        return base64.b64encode(faces.astype("<u4").tobytes()).decode()

    paints, on_solids = paints_of(g)
    way = facing(frames, g["faces"])
    data = {"paints": paints, "solidPaints": on_solids,
            "faces": indices(g.get("corners", g["faces"])), "solidFaces": indices(g["solid_faces"]),
            "frames": [packed(f["x"]) for f in frames],
            "solidFrames": [packed(x) for x in solids], "low": low.tolist(), "span": span.tolist(), "numbers": kept,
            "turn": round(float(np.arctan2(way[0], way[2])), 3),
            "tilt": round(float(np.arctan2(way[1], np.hypot(way[0], way[2]))), 3), "times": [float(f["t"]) for f in frames],
            "fps": recording.fps / every}
    return data, f"Every {every}th frame, to keep the page small." if every > 1 else ""


def paints_of(geometry: dict[str, np.ndarray]) -> tuple[list[list], list[list]]:
    """(first face, how many, linear RGB of the front, of the back) of runs of faces that are alike: of cloths, of solids."""
    drawn = surfaces(geometry, Look(), None)
    out: tuple[list[list], list[list]] = [], []
    if not len(drawn.faces):
        return out
    alike = np.column_stack([drawn.owner, drawn.colors, drawn.backs, np.arange(len(drawn.faces)) >= drawn.cloth_faces])
    starts = np.concatenate([[0], 1 + np.flatnonzero((alike[1:] != alike[:-1]).any(axis=1)), [len(alike)]])
    for first, end in zip(starts[:-1].tolist(), starts[1:].tolist()):
        solid = first >= drawn.cloth_faces
        sides = (drawn.mean_color(first, front) for front in (True, False))
        out[solid].append([first - drawn.cloth_faces * solid, end - first,
                           *([round(float(v), 4) for v in side] for side in sides)])
    return out


def _table(rows: list[tuple]) -> str:
    head, *rest = rows
    out = ["<table><tr>" + "".join(f"<th>{html.escape(str(c))}</th>" for c in head) + "</tr>"]
    out += ["<tr>" + "".join(f"<td>{html.escape(str(c))}</td>" for c in row) + "</tr>" for row in rest]
    return "".join([*out, "</table>"])
