"""Draw the picture of the README: a strip that flaps for ever in steady light.

    readme_picture.py [FILE]      default: book/_static/flapping-strip.svg

The shapes are those of one whole cycle, equally spaced in time and colored by it; the snap from one
to the next stands out as the widest gap.
"""

from __future__ import annotations

import argparse
import colorsys
import re
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from lissome import beams

ROOT = Path(__file__).resolve().parent.parent
ANGLE = np.pi / 4


def draw(target: Path) -> None:
    strip = beams.ClampedStrip(span=0.95, response=+1.0, segments=100)
    light = beams.ParallelLight(intensity=10.0, angle=ANGLE)
    history = strip.under(light).run(until=12.0)
    period = history.period
    times = history.times[-1] - period * np.linspace(1.0, 0.0, 28, endpoint=False)
    rows = [int(np.argmin(np.abs(history.times - t))) for t in times]

    settings = {"svg.hashsalt": "lissome", "svg.fonttype": "path"}
    with mpl.rc_context(settings):
        figure = Figure(figsize=(7.2, 2.9))
        canvas = FigureCanvasSVG(figure)
        axes = figure.add_axes((0, 0, 1, 1))
        # hues of one lightness, so that they stand out from light and from dark pages alike
        hues = (0.58 + 0.5 * np.arange(len(rows)) / len(rows)) % 1.0
        colors = [colorsys.hls_to_rgb(hue, 0.52, 0.55) for hue in hues]
        for row, color in zip(rows, colors, strict=True):
            x, y = history.x[row], history.y[row]
            axes.plot(x, y, color=color, linewidth=1.6, solid_capstyle="round")
        for place in (history.x[rows[0]][0], history.x[rows[0]][-1]):
            axes.plot([place, place], [-0.035, 0.035], color="#808892", linewidth=4)
        travel = -np.array(light.toward)
        for start in (0.0, 0.05, 0.1):
            tail = np.array([start, 0.15])
            axes.annotate(
                "",
                xy=tail + 0.09 * travel,
                xytext=tail,
                arrowprops={"arrowstyle": "-|>", "color": "#d28b00", "linewidth": 1.6},
            )
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.margins(0.02)
        figure.patch.set_alpha(0)
        canvas.print_svg(target, metadata={"Date": None, "Creator": None})
    text = re.sub(r"(\d+\.\d\d)\d+", r"\1", target.read_text(encoding="utf-8"))
    target.write_text(text, encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path)
    given = parser.parse_args(arguments)
    target = given.file or ROOT / "book" / "_static" / "flapping-strip.svg"
    draw(target)
    print(f"written: {target} ({target.stat().st_size / 1e3:.0f} kB)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
