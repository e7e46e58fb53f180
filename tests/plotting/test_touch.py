"""What a finger, the keyboard and a page without scripts make of a figure in space."""

import json
from pathlib import Path

import plotly
import plotly.graph_objects as go
import pytest

from lissome import plotting
from lissome.errors import InvalidInput

pytest.importorskip("playwright")

CAMERA = "() => document.querySelector('.plotly-graph-div')._fullLayout.scene.camera.eye"
SHOWN = "() => document.querySelector('.plotly-graph-div').data.map((trace) => trace.visible)"


def saddles():
    """A figure with a slider that shows one of three saddles."""
    heights = (1.0, 2.0, 3.0)
    fig = go.Figure(
        [go.Surface(z=[[0, a, 0], [-a, 0, -a], [0, a, 0]], visible=a == 2.0) for a in heights]
    )
    steps = [
        {"label": f"{a:g} m", "method": "restyle", "args": ["visible", [a == b for b in heights]]}
        for a in heights
    ]
    fig.update_layout(
        sliders=[{"active": 1, "currentvalue": {"prefix": "a = "}, "steps": steps}],
        scene={"camera": {"eye": {"x": 1.0, "y": 1.0, "z": 0.5}}},
    )
    return fig


@pytest.fixture(scope="module")
def window(tools, tmp_path_factory):
    """Return a function that opens a page with the figure on a phone, with or without plotly."""
    import check_pages
    from playwright.sync_api import sync_playwright

    executable = check_pages.find_browser()
    if executable is None:
        pytest.skip("no Chromium on this machine")
    folder = tmp_path_factory.mktemp("a page")
    script = (Path(plotly.__file__).parent / "package_data" / "plotly.min.js").read_bytes()
    (folder / "plotly.min.js").write_bytes(script)
    markup = plotting.show3d(saddles(), "a saddle that grows").markup
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=executable, args=check_pages.FLAGS)

        def open_page(head='<script defer src="plotly.min.js"></script>', **options):
            page = folder / "page.html"
            page.write_text(
                '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
                f'content="width=device-width, initial-scale=1">{head}</head><body>'
                f'<p style="height:200px">above</p>{markup}<p style="height:3000px">below</p></body>'
            )
            context = browser.new_context(
                viewport=check_pages.PHONE, has_touch=True, is_mobile=True, offline=True, **options
            )
            tab = context.new_page()
            tab.goto(page.as_uri())
            return tab

        yield open_page
        browser.close()


@pytest.fixture
def phone(window):
    tab = window()
    tab.wait_for_function("() => document.querySelector('.plotly-graph-div').tabIndex === 0")
    yield tab
    tab.context.close()


def middle(tab):
    box = tab.query_selector(".plotly-graph-div").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def comes(tab, ask):
    """Tell whether something comes true within half a minute: a browser answers in its time."""
    for _ in range(300):
        if ask():
            return True
        tab.wait_for_timeout(100)
    return False


def says(tab, words):
    return comes(tab, lambda: tab.query_selector("button").inner_text() == words)


def test_a_finger_scrolls_past_until_the_figure_is_tapped(phone):
    from check_pages import _swipe

    eye = phone.evaluate(CAMERA)
    _swipe(phone, *middle(phone), -100)
    assert comes(phone, lambda: phone.evaluate("scrollY") > 50)
    assert phone.evaluate(CAMERA) == eye

    phone.touchscreen.tap(*middle(phone))
    assert says(phone, "Tap to scroll")
    here = phone.evaluate("scrollY")
    _swipe(phone, *middle(phone), 30)
    assert comes(phone, lambda: phone.evaluate(CAMERA) != eye)
    assert phone.evaluate("scrollY") == here

    phone.touchscreen.tap(*middle(phone))
    assert says(phone, "Tap to turn")
    turned = phone.evaluate(CAMERA)
    _swipe(phone, *middle(phone), -100)
    assert comes(phone, lambda: phone.evaluate("scrollY") > here + 50)
    assert phone.evaluate(CAMERA) == pytest.approx(turned)


def test_the_button_says_what_a_tap_does_and_a_touch_elsewhere_holds_the_figure(phone):
    assert says(phone, "Tap to turn")
    phone.query_selector("button").tap()
    assert says(phone, "Tap to scroll")
    phone.touchscreen.tap(100, 50)
    assert says(phone, "Tap to turn")


def test_the_slider_is_a_form_control_as_high_as_a_finger(phone):
    bar = phone.query_selector("input[type=range]")
    box = bar.bounding_box()
    assert box["height"] >= 40
    assert phone.evaluate("() => document.querySelector('input').labels[0].textContent") == "a = "
    phone.touchscreen.tap(box["x"] + box["width"] - 8, box["y"] + 4)
    assert comes(phone, lambda: phone.evaluate(SHOWN) == [False, False, True])
    assert phone.inner_text("output") == bar.get_attribute("aria-valuetext") == "3 m"


def test_the_keyboard_turns_zooms_and_slides(phone):
    import math

    def polar():
        eye = phone.evaluate(CAMERA)
        return math.atan2(eye["y"], eye["x"]), math.hypot(*eye.values())

    phone.focus(".plotly-graph-div")
    angle, far = polar()
    phone.keyboard.press("ArrowRight")
    assert comes(phone, lambda: polar() == pytest.approx((angle + math.pi / 24, far)))
    phone.keyboard.press("+")
    assert comes(phone, lambda: polar() == pytest.approx((angle + math.pi / 24, 0.9 * far)))
    phone.keyboard.press(",")
    assert comes(phone, lambda: phone.evaluate(SHOWN) == [True, False, False])
    assert polar() == pytest.approx((angle + math.pi / 24, 0.9 * far))


def test_two_fingers_zoom_once_the_figure_is_loose(phone):
    def pinch():
        x, y = middle(phone)
        for reach in (20, 30, 40):
            points = [{"x": x + side * reach, "y": y, "id": side + 1} for side in (-1, 1)]
            kind = "touchMove" if reach > 20 else "touchStart"
            fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    fingers = phone.context.new_cdp_session(phone)
    eye = phone.evaluate(CAMERA)
    phone.query_selector("button").tap()
    assert says(phone, "Tap to scroll")
    pinch()
    half = pytest.approx({key: eye[key] / 2 for key in eye})
    assert comes(phone, lambda: phone.evaluate(CAMERA) == half)
    assert phone.evaluate("visualViewport.scale") == 1


def test_the_twin_stands_where_nothing_can_draw_and_else_nothing_jumps(window):
    tab = window(head="", java_script_enabled=False)
    assert tab.query_selector("img.lissome-print").is_visible()
    assert not tab.query_selector(".lissome-screen").is_visible()
    tab.context.close()

    tab = window(head="")  # a notebook without plotly.js
    assert tab.query_selector("img.lissome-print").is_visible()
    tab.context.close()

    tab = window()
    before = tab.query_selector(".lissome-drawing").bounding_box()
    tab.wait_for_function("() => document.querySelector('.plotly-graph-div').tabIndex === 0")
    assert tab.query_selector(".lissome-drawing").bounding_box() == before
    assert not tab.query_selector("img.lissome-print").is_visible()
    tab.context.close()


def test_one_slider_and_no_menu():
    fig = saddles()
    drawing = plotting.show3d(fig, "a saddle that grows")
    content = drawing.markup.split('type="application/json"')[1].split(">", 1)[1]
    given = json.loads(content.split("</script>")[0])
    assert not given["layout"].get("sliders")
    assert [step["label"] for step in given["steps"]] == ["1 m", "2 m", "3 m"]
    fig.update_layout(sliders=[{}, {}])
    with pytest.raises(InvalidInput, match="2 sliders"):
        plotting.show3d(fig, "a saddle that grows")
    fig = saddles()
    fig.layout.sliders = ()
    fig.update_layout(sliders=[{"active": 3, "steps": [{"label": "a"}]}])
    with pytest.raises(InvalidInput, match="active"):
        plotting.show3d(fig, "a saddle that grows")
