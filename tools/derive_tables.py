"""Write the tables of ``data/`` that are computed from published formulas, and seal them.

Run ``python tools/derive_tables.py`` from the root of the repository. Tests recompute the same
numbers in another way; this script exists so that the tables can be made again.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from mpmath import cos, cosh, mp, mpf, nstr, sin, sinh, sqrt

from lissome import literature
from lissome.references import (
    buckled_cantilever,
    circles,
    folding,
    lateral_buckling,
    moebius,
    ribbon_twist,
)
from lissome.references.ribbon_twist import Ribbon

DATA = Path(__file__).resolve().parents[1] / "data"
ARGUMENTS = [
    *("0", "0.1", "0.5", "1", "2", "5", "10", "20", "30", "50", "75", "100"),
    *("150", "200", "300", "500", "1000", "2000", "5000", "10000"),
]


def audoly_neukirch_phi(v: mpf) -> mpf:
    """Return phi(v), equation (2.8) of Audoly and Neukirch (2021), and its limit 1/360 at 0."""
    if v == 0:
        return mpf(1) / 360
    s = sqrt(abs(v) / 2)
    return 4 / v**2 * (mpf(1) / 2 - (cosh(s) - cos(s)) / (s * (sinh(s) + sin(s))))


def write(name: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with open(DATA / f"{name}.csv", "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
    literature.seal([name], folder=DATA)


def phi_rows() -> Iterable[list[str]]:
    mp.dps = (
        60  # the bracket cancels like v**2: sixty digits leave fifteen at v = 0.1 and far below
    )
    for text in ARGUMENTS:
        v = mpf(text)
        yield [
            text,
            nstr(audoly_neukirch_phi(v), 15),
            nstr(1 / (360 + v**2 / 2), 15),
            "" if v == 0 else nstr(2 / v**2, 15),
        ]


def digits(value: float, count: int = 10) -> str:
    """Return a number to `count` decimals, all of them certain; zero without a sign."""
    return f"{round(float(value), count) + 0.0:.{count}f}"


def cantilever_rows() -> Iterable[list[str]]:
    """Fig. 4.4 of the thesis: loads up to five times the critical one."""
    for kind, critical, tips in (
        ("end", buckled_cantilever.end_loads()[0], buckled_cantilever.end_load_tips),
        (
            "distributed",
            buckled_cantilever.distributed_loads()[0],
            buckled_cantilever.distributed_load_tips,
        ),
    ):
        steps = [*np.linspace(0.0, 1.0, 5), *np.linspace(1.0, 1.2, 11)[1:]]
        ratios = np.array([*steps, *np.linspace(1.2, 5.0, 39)[1:]])
        loads = np.round(ratios * critical, 6)
        for load, (x, y) in zip(loads, tips(loads), strict=True):
            yield [kind, digits(load, 6), digits(x), digits(y)]


def slinky(constant: float | None, radial: str = "width") -> circles.RingSection:
    """Bar of 5 mm by 2 mm with Poisson's ratio 0.41; the exact torsion constant by default."""
    return circles.RingSection.rectangle(5.0, 2.0, 0.41, radial=radial, torsion_constant=constant)


TORSION = {"thesis": 0.256, "exact": None}


def threshold_rows() -> Iterable[list[str]]:
    for name, constant in TORSION.items():
        for radial in ("width", "thickness"):
            for turns in (1, 2, 3, 4):
                low, high = circles.stable_range(slinky(constant, radial), turns)
                yield [name, radial, str(turns), digits(low), digits(high)]


def slinky_rows() -> Iterable[list[str]]:
    """Fig. 4.5b of the thesis."""
    for name, constant in TORSION.items():
        section = slinky(constant)
        onset, end = circles.mode_threshold(section, 1, 2), circles.mode_threshold(section, 3, 2)
        for o in np.round(np.linspace(1.0, 3.1, 106), 2):
            if onset < o < end:
                fold = folding.folded_ring(section, float(o))
                values = [fold.crest_distance, fold.height]
                energy = fold.energy / section.in_plane
                twist = fold.largest_twist
            else:
                turns = 1 if o <= onset else 3
                values = [(2 - turns) / (turns * np.pi), 0.0]
                energy, twist = 0.5 * (2.0 * np.pi * (turns - o)) ** 2, 0.0
            row = [abs(values[0]), *values, energy, twist]
            yield [name, f"{o:.2f}", *map(digits, row)]


def shape_rows() -> Iterable[list[str]]:
    """Fig. 4.5a of the thesis, with its torsion constant."""
    for o in (1.2, 1.5, 2.0, 2.5, 2.8):
        fold = folding.folded_ring(slinky(TORSION["thesis"]), o)
        s = np.arange(65) / 64
        for place, point, strain in zip(s, fold.points(s), fold.strains(s), strict=True):
            yield [f"{o:.1f}", f"{place:.6f}", *map(digits, point), *map(digits, strain)]


FORMS = ("thesis", "audoly-neukirch", "panda-jawed")
POISSON_RATIOS = (0.2, 0.3, 0.4, 0.5)


def clamp_values(state: ribbon_twist.Equilibrium) -> list[float]:
    """What starts an integration at the clamp: moment m1, strains k2 and k3, and the force."""
    return [*state.solution.nodes[0, 7:10], float(state.force[0])]


def snap_rows() -> Iterable[list[str]]:
    """The narrow ribbon of Fig. 4.6 of the thesis at the fold, and where it lands."""
    for form in FORMS:
        for nu in POISSON_RATIOS:
            ribbon = Ribbon(8.0, poisson_ratio=nu, form=form)
            fold = ribbon_twist.critical_twist(ribbon)
            # beyond the fold: the image by reflection of the state at pi - phi
            image = ribbon_twist.equilibrium(ribbon, np.pi - fold.twist)
            middle = [*fold.midpoint[1:], -image.midpoint[1], image.midpoint[2]]
            numbers = [fold.twist, *middle, fold.energy, image.energy, *clamp_values(fold)]
            yield [form, f"{nu:.1f}", *(digits(x, 8) for x in numbers)]


def twist_rows() -> Iterable[list[str]]:
    """Fig. 4.6 of the thesis: mirror-symmetric branches of both widths."""
    for width, until, count in ((8.0, 3.3, 115), (15.0, np.pi, 400)):
        for nu in (0.3, 0.4):
            ribbon = Ribbon(width, poisson_ratio=nu)
            branch = ribbon_twist.trace(ribbon, until=until, count=count)
            for state in branch.states:
                middle = [state.twist, *state.midpoint[1:], state.tilt]
                lowest = ribbon_twist.stability(state)
                numbers = [*middle, *lowest, *clamp_values(state)]
                yield [f"{width:g}", f"{nu:.1f}", *(digits(x, 8) for x in numbers)]


def ribbon_threshold_rows() -> Iterable[list[str]]:
    """For the thesis's xi; the other forms differ by the fourth root of their factor."""
    for nu in POISSON_RATIOS:
        bracket = ribbon_twist.threshold_width(Ribbon(8.0, poisson_ratio=nu))
        yield [f"{nu:.1f}", *(digits(x, 5) for x in bracket)]


def lateral_rows() -> Iterable[list[str]]:
    """The ribbons of Audoly and Neukirch: thickness 0.0925 mm, gravity length 62.3 mm, nu = 0.4."""
    for width in (1.88, 5.10, 20.05):
        for rotation in (0.01, 0.1, 0.3):
            length = lateral_buckling.overhang(rotation, 0.0925, width, 62.3, 0.4)
            load = (length / 62.3) ** 3
            yield [f"{width:.2f}", f"{rotation:g}", digits(load, 6), digits(length, 5)]


HALF_WIDTHS = ("0", "0.1", "0.2", "0.5", "0.8", "1.0", "1.5")  # of the drawn strips, for L = 2 pi


def moebius_rows() -> Iterable[list[str]]:
    """Widths drawn by Starostin and van der Heijden, and some nearer to the limit 1/sqrt(3)."""
    for text in (*HALF_WIDTHS, "1.6", "1.7", "1.75", "1.8"):
        band = moebius.band(float(text) / np.pi)
        middle, ruling = band.strains(0.5), float(band.ruling(0.5))
        numbers = [band.energy, band.twist, band.writhe(128), middle[0], middle[2], ruling]
        yield [text, digits(band.width), *(digits(x, 8) for x in (*numbers, *band.load))]


def moebius_strain_rows() -> Iterable[list[str]]:
    """Denser towards the inflection, where the strains are not smooth."""
    for text in HALF_WIDTHS:
        band = moebius.band(float(text) / np.pi)
        s = 0.5 * (np.arange(201) / 200) ** 2
        columns = (s, *band.strains(s)[:, [0, 2]].T, band.ruling(s))
        for row in zip(*columns, strict=True):
            yield [text, *(digits(x, 8) for x in row)]


def main() -> None:
    write("audoly-neukirch-phi", ["v", "phi", "phi_sano_wada", "large_v"], phi_rows())
    write("cantilever-tips", ["load_type", "load", "x", "y"], cantilever_rows())
    write("slinky-thresholds", ["torsion", "radial", "turns", "low", "high"], threshold_rows())
    write(
        "slinky-continuum",
        ["torsion", "overcurvature", "distance", "crest_distance", "height", "energy", "twist"],
        slinky_rows(),
    )
    write(
        "slinky-shapes",
        ["overcurvature", "position", "x", "y", "z", "bending_out", "bending_in", "twist"],
        shape_rows(),
    )
    clamp = ["clamp_moment", "clamp_bending", "clamp_twist", "force"]
    write(
        "ribbon-snap",
        [
            *("xi_form", "poisson_ratio", "twist", "out_of_plane", "in_plane"),
            *("landed_out_of_plane", "landed_in_plane", "energy", "landed_energy", *clamp),
        ],
        snap_rows(),
    )
    write(
        "ribbon-twist-branches",
        [
            *("width", "poisson_ratio", "twist", "out_of_plane", "in_plane", "tilt"),
            *("symmetric", "antisymmetric", *clamp),
        ],
        twist_rows(),
    )
    write("ribbon-thresholds", ["poisson_ratio", "low", "high"], ribbon_threshold_rows())
    write("lateral-buckling", ["width", "rotation", "load", "overhang"], lateral_rows())
    write(
        "moebius-energies",
        [
            *("half_width", "width", "energy", "twist", "writhe", "middle_bending"),
            *("middle_twisting", "middle_ruling", "force_y", "force_z", "moment_y", "moment_z"),
        ],
        moebius_rows(),
    )
    write(
        "moebius-strain-curves",
        ["half_width", "position", "bending", "twisting", "ruling"],
        moebius_strain_rows(),
    )


if __name__ == "__main__":
    main()
