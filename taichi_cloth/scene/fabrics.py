"""Measured cloths, in SI units, as others have published them: `tc.fabrics["shirting"]`. Values that were not measured are
left out.

- Wang, O'Brien, Ramamoorthi 2011, "Data-driven elastic models for cloth", as shipped with ARCSim: density, stretch at small
  strains and at 17 %, shear and bending, of which here the small-strain ones.
- Clyde, Teran, Tamstorf 2017, "Modeling and data-driven parameter estimation for woven fabrics", as tabulated by Codim-IPC:
  which of its directions is warp is inferred. Their bending is the median of a class of fabrics of Feng et al. 2022.

Nobody measured damping, nor friction with skin or with themselves: damping is 0 here, and friction is yours to choose. Nor
was it measured for these how wide the loop of their bending is (2HB), so they have no friction of bending.

For other cloths that loop was measured, with bending but without a density: `tc.bends["wool_tropical"]`, for a `Fabric` of
your own. The curvature at which a cloth yields was measured for none of them.

- Matsudaira, Masuda, Wada, Yokura 2015, J. Textile Eng. 61(6), tables 1 and 2, as quoted by others.
- Journal of Textiles 2016, article 4614168, table 5: six cellulosic denims, means of warp and weft.
"""

from dataclasses import dataclass
from typing import TypeVar

from .. import checks
from ..errors import NameUnknown, did_you_mean, shown
from .fabric import Bend, Fabric, Shear, Stretch

T = TypeVar("T")
WANG = "Wang et al. 2011, as shipped with ARCSim"
MATSUDAIRA = "Matsudaira et al. 2015, KES-FB2, as quoted"
DENIMS = "Journal of Textiles 2016, 4614168, KES-F"
CLYDE = "Clyde et al. 2017, as tabulated by Codim-IPC; bending: class median of Feng et al. 2022"


@dataclass(frozen=True)
class Measured(Fabric):
    """A fabric with where its numbers come from.

    Attributes:
        source: who measured it.
        thickness: [m], or None if it was not measured.
        far: stretch stiffness [N/m] of (warp, weft) at a strain of 17 %, where it was measured.
    """

    source: str = ""
    thickness: float | None = None
    far: tuple[float, float] | None = None

    def scaled(self, density: float = 1.0, stretch: float = 1.0, shear: float = 1.0, bend: float = 1.0) -> Fabric:
        """The fabric of `Fabric.scaled`; the result is a plain `Fabric`, as nobody measured it."""
        return Fabric(self.density, self.stretch, self.shear, self.bend).scaled(density, stretch, shear, bend)


@dataclass(frozen=True)
class MeasuredBend(Bend):
    """Bending with the width of its loop, and where its numbers come from.

    Attributes:
        source: who measured it.
    """

    source: str = ""


def _wang(density: float, k: tuple[float, float], shear: float, D: tuple[float, float],
          far: tuple[float, float] | None = None) -> Measured:
    bend = Bend((D[0] * 1e-6, D[1] * 1e-6))
    return Measured(density, Stretch(k), Shear(shear), bend, WANG, far=far)


def _clyde(density: float, k: tuple[float, float], shear: float, D: tuple[float, float], thickness: float) -> Measured:
    return Measured(density, Stretch(k), Shear(shear), Bend((D[0] * 1e-6, D[1] * 1e-6)), CLYDE, thickness * 1e-3)


class Table(dict[str, T]):
    """Values by name; a name that is not there is answered with the nearest.

    Args:
        what: the kind of thing they are, in messages.
        everyday: names by other words for them, in small letters alone.
    """

    def __init__(self, what: str, values: dict[str, T], everyday: dict[str, str] | None = None) -> None:
        super().__init__(values)
        self.what, self.everyday = what, everyday or {}

    def __missing__(self, name: object) -> T:
        word = "".join(c for c in name.lower() if c.isalpha()) if isinstance(name, str) else ""
        raise NameUnknown(f"unknown {self.what} {shown(name)}; {did_you_mean(self.everyday.get(word, name), self)}")


# Words for garments and cloths, and the measured one that is nearest.
EVERYDAY = {"jeans": "denim", "jersey": "interlock", "tshirt": "interlock", "shirt": "shirting", "cotton": "shirting",
            "linen": "tablecloth", "silk": "charmeuse", "satin": "charmeuse", "wool": "wool_coating", "coat": "wool_coating",
            "felt": "wool_coating", "sweater": "rib_knit", "knit": "rib_knit", "jacket": "jacket_polyester",
            "polyester": "jacket_polyester", "nylon": "jacket_polyester", "sail": "canvas", "tent": "canvas",
            "curtain": "charmeuse", "pants": "trousers", "spandex": "swimwear", "lycra": "swimwear"}


# Twelve measured cloths, by name.
fabrics: Table[Measured] = Table("fabric", {
    "interlock": _wang(0.187, (33.0, 69.0), 37.0, (5.8, 3.6), (93.0, 812.0)),
    "rib_knit": _wang(0.276, (86.0, 130.0), 83.0, (11.6, 8.1), (105.0, 509.0)),
    "ponte": _wang(0.284, (62.0, 88.0), 32.0, (9.1, 9.3), (157.0, 384.0)),
    "swimwear": _wang(0.204, (96.0, 209.0), 61.0, (15.0, 13.0), (81.0, 249.0)),
    "jacket_polyester": _wang(0.113, (86.0, 343.0), 14.0, (3.6, 5.1), (150.0, 810.0)),
    "trousers": _wang(0.220, (4033.0, 4070.0), 105.0, (31.0, 31.0)),
    "tablecloth": _wang(0.128, (4004.0, 4055.0), 19.0, (13.0, 7.8)),
    "denim": _wang(0.324, (411.0, 2028.0), 53.0, (16.0, 24.0)),
    "shirting": _clyde(0.104, (2800.0, 4501.0), 97.0, (8.6, 5.2), 0.18),
    "charmeuse": _clyde(0.083, (774.0, 1790.0), 51.0, (3.2, 3.2), 0.18),
    "canvas": _clyde(0.294, (2844.0, 10496.0), 532.0, (20.0, 14.0), 0.53),
    "wool_coating": _clyde(0.481, (2931.0, 2840.0), 237.0, (75.0, 39.0), 1.28),
}, EVERYDAY)


def _kes(D: float, two_HB: float, source: str) -> MeasuredBend:
    """From D [uN m] and 2HB [mN]."""
    return MeasuredBend(D * 1e-6, friction=two_HB / 2 * 1e-3, source=source)


# Nine measured loops of bending, by name.
bends: Table[MeasuredBend] = Table("bend", {
    "cotton_broadcloth": _kes(11.57, 1.216, MATSUDAIRA),
    "wool_tropical": _kes(6.570, 0.3236, MATSUDAIRA),
    "polyester_faille": _kes(1.863, 0.06865, MATSUDAIRA),
    "denim_a": _kes(16.87, 1.363, DENIMS),
    "denim_b": _kes(14.12, 1.393, DENIMS),
    "denim_c": _kes(22.26, 1.030, DENIMS),
    "denim_d": _kes(14.42, 1.383, DENIMS),
    "denim_e": _kes(20.30, 2.099, DENIMS),
    "denim_f": _kes(14.51, 1.559, DENIMS),
})


def as_fabric(what: str, value: object) -> Fabric:
    """A fabric, or the measured one of a name, such as "denim".

    Raises:
        SceneError: it is neither.
    """
    return fabrics[value] if isinstance(value, str) else checks.instance(what, value, Fabric)


def table() -> str:
    """The fabrics, and bending with its loop, as lines of text."""
    head = f"{'fabric':18}{'kg/m2':>7}{'k warp':>8}{'weft':>8}{'shear':>7}{'D warp':>8}{'weft':>7}{'mm':>6}  source"
    lines = [head, f"{'':18}{'':7}{'N/m':>8}{'N/m':>8}{'N/m':>7}{'uN m':>8}{'uN m':>7}"]
    for name, f in fabrics.items():
        assert f.stretch and f.shear and f.bend and isinstance(f.stretch.k, tuple) and isinstance(f.bend.D, tuple)
        thick = "" if f.thickness is None else f"{1e3 * f.thickness:.2f}"
        stiff = f"{f.stretch.k[0]:8.0f}{f.stretch.k[1]:8.0f}{f.shear.k:7.0f}"
        lines.append(f"{name:18}{f.density:7.3f}{stiff}{1e6 * f.bend.D[0]:8.1f}{1e6 * f.bend.D[1]:7.1f}{thick:>6}  {f.source}")
    lines += ["Damping and friction were not measured, nor the loop of bending (HB), nor where they yield.", "",
              "Bending that was measured with its loop M = D kappa +- HB, of cloths of unknown density (tc.bends):",
              f"{'bend':18}{'D':>8}{'HB':>8}{'HB/D':>7}  source", f"{'':18}{'uN m':>8}{'mN':>8}{'1/m':>7}"]
    for name, b in bends.items():
        assert isinstance(b.D, float) and isinstance(b.friction, float)
        lines.append(f"{name:18}{1e6 * b.D:8.2f}{1e3 * b.friction:8.3f}{b.friction / b.D:7.0f}  {b.source}")
    return "\n".join(lines)
