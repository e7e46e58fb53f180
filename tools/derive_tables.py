"""Write the tables of ``data/`` that are computed from published formulas, and seal them.

Run ``python tools/derive_tables.py`` from the root of the repository. Tests recompute the same
numbers in another way; this script exists so that the tables can be made again.
"""

from __future__ import annotations

import csv
from pathlib import Path

from mpmath import cos, cosh, mp, mpf, nstr, sin, sinh, sqrt

from lissome import literature

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


def main() -> None:
    mp.dps = (
        60  # the bracket cancels like v**2: sixty digits leave fifteen at v = 0.1 and far below
    )
    with open(DATA / "audoly-neukirch-phi.csv", "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["v", "phi", "phi_sano_wada", "large_v"])
        for text in ARGUMENTS:
            v = mpf(text)
            writer.writerow(
                [
                    text,
                    nstr(audoly_neukirch_phi(v), 15),
                    nstr(1 / (360 + v**2 / 2), 15),
                    "" if v == 0 else nstr(2 / v**2, 15),
                ]
            )
    literature.seal(["audoly-neukirch-phi"], folder=DATA)


if __name__ == "__main__":
    main()
