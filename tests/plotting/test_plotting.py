"""Pictures: labeled, described, theme-following, moving, and asking nothing of a network."""

import base64
import io
import re
import subprocess
import sys
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import plotly.graph_objects as go
import pytest
from matplotlib.patches import ConnectionPatch
from PIL import Image

from lissome import plotting
from lissome.errors import InvalidInput
from lissome.plotting._palette import DARK_PAGE, LIGHT_PAGE, PALETTE, SERIES

ALT = "a curve that rises to the right"


def _sample(size=(4, 3)):
    fig, ax = plotting.figure(size=size)
    ax.plot([0, 1], [0, 2], label="a")
    ax.set_xlabel("time $T$")
    ax.set_ylabel("height")
    plotting.legend(ax)
    return fig, ax


def _rgb(value):
    return np.array([int(value[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def _linear(rgb):
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def _contrast(a, b):
    light = sorted(float(_linear(_rgb(c)) @ [0.2126, 0.7152, 0.0722]) for c in (a, b))
    return (light[1] + 0.05) / (light[0] + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_color_can_be_read_on_its_page(theme):
    page = {"light": LIGHT_PAGE, "dark": DARK_PAGE}[theme]
    for role in SERIES:
        assert _contrast(getattr(PALETTE[role], theme), page) >= 3.0, role  # WCAG, graphics
    assert _contrast(getattr(PALETTE["ink"], theme), page) >= 7.0  # WCAG AAA, text


# Machado, Oliveira and Fernandes (2009), severity 1, acting on linear RGB.
_DEFICIENT = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
               [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
               [-0.011820, 0.042940, 0.968881]],
}  # fmt: skip


def _lab(linear):
    xyz = (
        np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
        @ np.clip(linear, 0, 1)
        / [0.9505, 1.0, 1.089]
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("kind", sorted(_DEFICIENT))
def test_the_first_three_series_stay_apart_for_color_blind_readers(theme, kind):
    seen = [
        _lab(np.array(_DEFICIENT[kind]) @ _linear(_rgb(getattr(PALETTE[r], theme))))
        for r in SERIES[:3]
    ]
    for i in range(3):
        for j in range(i):
            assert np.linalg.norm(seen[i] - seen[j]) > 15  # clearly visible difference


def test_the_palette_can_be_told_from_every_other_color():
    values = [hue.light for hue in PALETTE.values()]
    assert len(set(values)) == len(values)  # replaced by value afterwards


def test_figure_has_the_size_asked_for_and_labels():
    fig, ax = _sample(size=(4, 3))
    assert tuple(fig.get_size_inches()) == (4, 3)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time $T$", "height")
    with Image.open(io.BytesIO(plotting.show(fig, ALT).still)) as picture:
        assert picture.size == (640, 480)


def test_svg_is_well_formed_described_and_follows_the_theme():
    drawing = plotting.show(_sample()[0], ALT)
    source = drawing.markup[drawing.markup.index("<svg") : drawing.markup.index("</svg>") + 6]
    root = ElementTree.fromstring(source)
    assert root.get("role") == "img"
    assert root.get("aria-label") == ALT
    assert "var(--lissome-blue," in source  # the line
    assert "var(--lissome-ink," in source  # axes and text
    bare = re.sub(r"var\(--lissome-\w+,#[0-9a-f]{6}\)", "", source)
    assert not re.findall(r"#[0-9a-f]{6}\b", bare)  # no color escapes the theme
    for hue in PALETTE.values():
        assert hue.dark in drawing.markup


def test_ids_of_two_figures_on_one_page_differ():
    def ids(drawing):
        return set(re.findall(r'\bid="([^"]+)"', drawing.markup))

    first, second = plotting.show(_sample((4, 3))[0], ALT), plotting.show(_sample((5, 3))[0], ALT)
    assert ids(first)
    assert not ids(first) & ids(second)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', first.markup))
    assert used <= ids(first)


def test_the_same_figure_gives_the_same_bytes():
    first, second = (plotting.show(_sample()[0], ALT) for _ in range(2))
    assert first.markup == second.markup
    assert first.still == second.still


@pytest.mark.parametrize("alt", ["", "  ", "figure", None, 3])
def test_no_picture_without_words(alt):
    with pytest.raises(InvalidInput, match="alt"):
        plotting.show(_sample()[0], alt)


def test_nothing_leaks_into_matplotlib():
    before = dict(mpl.rcParams)
    fig, ax = _sample()
    plotting.heatmap(ax, [0, 1], [0, 1], np.eye(2), "value")
    plotting.show(fig, ALT)
    assert dict(mpl.rcParams) == before
    import matplotlib.pyplot as plt

    assert plt.get_fignums() == []


def test_importing_the_library_imports_no_matplotlib_and_plotting_no_pyplot():
    code = (
        "import sys, lissome; assert 'matplotlib' not in sys.modules\n"
        "import lissome.plotting; assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert 'plotly' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_markup_asks_nothing_of_a_network():
    fig, _ = _sample()
    drawings = [
        plotting.show(fig, ALT),
        plotting.animate(_sample()[0], lambda i: None, 2, alt=ALT),
        plotting.show3d(go.Figure(go.Scatter3d(x=[0, 1], y=[0, 1], z=[0, 1])), ALT),
    ]
    for drawing in drawings:
        addresses = re.findall(r'(?:src|srcset|href)="([^"]{4})', drawing.markup)
        assert all(a == "data" or a.startswith("#") for a in addresses)
        assert "<script src" not in drawing.markup
        assert "sendChartToCloud" not in re.sub(
            r'"modeBarButtonsToRemove":\s*\[[^]]*\]', "", drawing.markup
        )


def _webp(drawing):
    content = re.search(r'<img[^>]*src="data:image/webp;base64,([^"]+)"', drawing.markup).group(1)
    return Image.open(io.BytesIO(base64.b64decode(content)))


def test_animation_has_its_frames_duration_and_a_static_twin():
    fig, ax = plotting.figure(size=(3, 2))
    line = plotting.curve(ax, [[0, 0], [1, 0]])
    ax.set_ylim(-1, 1)

    def draw(i):
        line.set_ydata([0, np.sin(i)])

    drawing = plotting.animate(fig, draw, 12, alt=ALT, seconds=1.2, still=3)
    with _webp(drawing) as film:
        assert film.n_frames == 12
        assert film.info["loop"] == 0
        assert film.size == (330, 220)
        durations = []
        frames = []
        for i in range(12):
            film.seek(i)
            film.load()
            durations.append(film.info["duration"])
            frames.append(np.asarray(film.convert("RGBA")))
        assert sum(durations) == 1200
        assert (frames[0] != frames[5]).any()  # it moves
        assert (frames[0][..., 3] == 0).mean() > 0.5  # the page shows through
    draw(3)
    with mpl.rc_context(plotting._display.STYLE):
        assert drawing.still == plotting._display.png(fig)
    assert f'alt="{ALT}"' in drawing.markup


def test_animation_needs_two_frames():
    with pytest.raises(InvalidInput, match="frames"):
        plotting.animate(_sample()[0], lambda i: None, 1, alt=ALT)


def test_interactive_figure_is_left_unchanged_and_twinned():
    x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 2, 7))
    fig = go.Figure(go.Surface(x=x, y=y, z=x * y))
    before = fig.to_json()
    drawing = plotting.show3d(fig, ALT)
    assert fig.to_json() == before
    assert "plotly-graph-div" in drawing.markup
    assert '"displaylogo":false' in drawing.markup
    legend = re.search(r'"legend":\{[^}]*\}', drawing.markup).group()
    assert '"orientation":"h"' in legend  # below the scene, which has the width of a phone
    with Image.open(io.BytesIO(drawing.still)) as twin:
        grey = np.asarray(twin.convert("L"))
        assert (grey < 250).mean() > 0.02  # something is drawn
    with pytest.raises(InvalidInput, match=r"plotly\.graph_objects\.Figure"):
        plotting.show3d(_sample()[0], ALT)
    with pytest.raises(InvalidInput, match="twin"):
        plotting.show3d(go.Figure(go.Cone(x=[0], y=[0], z=[0], u=[1], v=[0], w=[0])), ALT)


def test_twin_draws_meshes_and_curves():
    mesh = go.Mesh3d(x=[0, 1, 0, 0], y=[0, 0, 1, 0], z=[0, 0, 0, 1],
                     i=[0, 0, 0], j=[1, 2, 3], k=[2, 3, 1])  # fmt: skip
    points = go.Scatter3d(x=[0, 1], y=[0, 1], z=[0, 1], mode="markers")
    twin = plotting.static_twin(go.Figure([mesh, points]))
    (ax,) = twin.axes
    assert len(ax.collections) == 1
    assert len(ax.lines) == 1


def test_twin_has_the_colors_of_the_figure():
    tetrahedron = {"x": [0, 1, 0, 0], "y": [0, 0, 1, 0], "z": [0, 0, 0, 1]}
    faces = {"i": [0, 0, 0], "j": [1, 2, 3], "k": [2, 3, 1]}
    line = go.Scatter3d(x=[0, 1], y=[0, 1], z=[0, 1], mode="lines", line={"color": "#00876a"})
    flat = [[0, "#d55e00"], [1, "#d55e00"]]
    sheet = go.Surface(z=[[0, 1], [1, 0]], colorscale=flat)
    mesh = go.Mesh3d(**tetrahedron, **faces, color="#a03d84")
    (ax,) = plotting.static_twin(go.Figure([line, mesh, sheet])).axes
    assert ax.lines[0].get_color() == "#00876a"
    for collection, hue in zip(ax.collections, ("#a03d84", "#d55e00"), strict=True):
        shades = collection.get_facecolor()[:, :3]
        brightest = shades[np.argmax(shades.sum(axis=1))]
        target = np.array(mpl.colors.to_rgb(hue))
        cosine = brightest @ target / np.linalg.norm(brightest) / np.linalg.norm(target)
        assert cosine > 0.999  # light changes the brightness, not the hue


@pytest.mark.parametrize(("angle", "expected"), [(0.0, [0, -1]), (np.pi / 2, [1, 0])])
def test_ray_direction(angle, expected):
    np.testing.assert_allclose(plotting.ray_direction(angle), expected, atol=1e-15)


def test_light_arrows_point_along_the_light_and_span_the_width():
    _, ax = plotting.figure()
    along = plotting.ray_direction(0.4)
    plotting.light_arrows(ax, 3 * along, (0.5, 0.2), length=0.1, width=0.6, count=7)
    assert len(ax.texts) == 7
    tips = np.array([t.xy for t in ax.texts])
    tails = np.array([t.get_position() for t in ax.texts])
    np.testing.assert_allclose(tips - tails, np.tile(0.1 * along, (7, 1)), atol=1e-15)
    assert np.isclose(np.linalg.norm(tips[-1] - tips[0]), 0.6)
    np.testing.assert_allclose(tips.mean(axis=0), [0.5, 0.2])
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    for points in (tips, tails):  # no ray is cut off
        assert np.all((left < points[:, 0]) & (points[:, 0] < right))
        assert np.all((low < points[:, 1]) & (points[:, 1] < high))
    with pytest.raises(InvalidInput, match="direction"):
        plotting.light_arrows(ax, (0, 0), (0, 0))


@pytest.mark.parametrize("logarithmic", [False, True])
def test_heatmap_cells_surround_their_points(logarithmic):
    fig, ax = plotting.figure()
    x, y = np.array([0.0, 1.0, 3.0]), np.array([1.0, 10.0])
    table = np.array([[1.0, 2.0, np.nan], [4.0, 5.0, 6.0]])
    mesh = plotting.heatmap(ax, x, y, table, "frequency", logarithmic=logarithmic)
    corners = mesh.get_coordinates()
    edges_x, edges_y = corners[0, :, 0], corners[:, 0, 1]
    assert np.all((edges_x[:-1] < x) & (x < edges_x[1:]))
    assert np.all((edges_y[:-1] < y) & (y < edges_y[1:]))
    np.testing.assert_array_equal(mesh.get_array().mask, np.isnan(table))
    assert fig.axes[-1].get_title() == "frequency"


def test_heatmap_says_what_is_wrong():
    _, ax = plotting.figure()
    with pytest.raises(InvalidInput, match=r"shape \(2, 3\)"):
        plotting.heatmap(ax, [0, 1, 2], [0, 1], np.zeros((3, 2)), "v")
    with pytest.raises(InvalidInput, match="increasing"):
        plotting.heatmap(ax, [0, 2, 1], [0, 1], np.zeros((2, 3)), "v")


def test_unknown_role_is_refused():
    with pytest.raises(InvalidInput, match="role"):
        plotting.color("mauve")


def test_panels_are_lettered():
    _, axes = plotting.figure(1, 2, panels="cd")
    assert [ax.get_title(loc="left") for ax in axes] == ["(c)", "(d)"]
    with pytest.raises(InvalidInput, match="panels"):
        plotting.figure(2, 2, panels="ab")


def test_drawing_helpers_keep_proportions():
    _, ax = plotting.figure()
    line = plotting.curve(ax, [[0, 0], [1, 0.2]], hue="orange")
    assert line.get_color() == plotting.color("orange")
    assert ax.get_aspect() == 1.0
    plotting.clamps(ax, 0.0, 0.95, height=0.1)
    spans = sorted((p.get_x(), p.get_x() + p.get_width()) for p in ax.patches)
    np.testing.assert_allclose(spans, [(-0.1, 0.0), (0.95, 1.05)])
    plotting.ground(ax, -1, 2)
    plotting.bare(ax)
    assert not ax.axison


def test_tiles_lead_to_their_pages_and_have_one_static_twin():
    entries = [
        (_sample((2, 1))[0], "one & only", "a.html", "a curve that rises"),
        (_sample((1, 2))[0], "two", "b.html", "another curve that rises"),
    ]
    drawing = plotting.tiles(entries)
    assert re.findall(r'<a href="([^"]+)">', drawing.markup) == ["a.html", "b.html"]
    assert "<span>one &amp; only</span>" in drawing.markup
    assert drawing.markup.count('role="img"') == 2
    with Image.open(io.BytesIO(drawing.still)) as twin:
        assert twin.size == (480, 320)  # 160 dots per inch, side by side
    for wrong in ("https://example.org/a.html", "/a.html"):
        with pytest.raises(InvalidInput, match="relative"):
            plotting.tiles([(*entries[0][:2], wrong, entries[0][3])])
    with pytest.raises(InvalidInput, match="at least one"):
        plotting.tiles([])


def _windows(drawing):
    return [
        [float(number) for number in box.split()]
        for box in re.findall(r'<svg viewBox="([^"]+)"', drawing.markup)
    ]


def test_panels_side_by_side_are_windows_that_tile_the_figure():
    fig, axes = plotting.figure(2, 2, size=(7, 4), panels=True, sharey=True)
    image = axes[0, 0].imshow(np.eye(3), aspect="auto")
    fig.colorbar(image, ax=axes[0, 0], label="a bar")
    drawing = plotting.show(fig, ALT)
    source = drawing.markup[
        drawing.markup.index('<div role="img"') : drawing.markup.rindex("</div>")
    ]
    root = ElementTree.fromstring(source.replace("xlink:href", "href"))  # HTML knows the prefix
    assert root.get("aria-label") == ALT
    assert [len(row) for row in root] == [2, 2]  # the bar is no panel
    boxes = np.array(_windows(drawing))
    assert boxes[:, 2] @ boxes[:, 3] == pytest.approx(7 * 4 * 72**2, rel=1e-3)
    assert boxes[0, :2] == pytest.approx(0)  # first the upper left one
    assert (boxes[3, :2] + boxes[3, 2:]) == pytest.approx([7 * 72, 4 * 72])
    assert len({box.tobytes() for box in boxes[:, :2]}) == 4  # all corners differ
    (content,) = set(re.findall(r'<use href="#(\w+figure_1)"', source))
    assert source.count(f'id="{content}"') == 1  # drawn once
    for ax in axes.flat:  # each can be read alone
        assert any(tick.label1.get_visible() for tick in ax.yaxis.get_major_ticks())


@pytest.mark.parametrize("joined", ["one axes", "a column", "an arrow between the axes"])
def test_what_no_straight_cut_parts_stays_whole(joined):
    fig, axes = plotting.figure(*{"one axes": (1, 1), "a column": (2, 1)}.get(joined, (1, 2)))
    if joined == "an arrow between the axes":
        fig.add_artist(
            ConnectionPatch((0.5, 0.5), (0.5, 0.5), "axes fraction", axesA=axes[0], axesB=axes[1])
        )
    drawing = plotting.show(fig, ALT)
    assert _windows(drawing) == []
    assert f'role="img" aria-label="{ALT}"' in drawing.markup
