"""What runs in the page beside a 3-D figure: one script, written into the page with the figure.

``NAME`` stands for the id of the figure. The script begins to draw when the figure comes near the
window, so that a long page is there at once; where plotly.js is missing, the static twin stays.
"""

from __future__ import annotations

__all__ = ["SCRIPT", "SPACE_SHEET"]

#: Beside figures in space: twin and figure change places, the slider and the button fit a finger.
SPACE_SHEET = (
    "<style>"
    ".lissome-screen{position:relative;display:none}"
    ".lissome-live>.lissome-screen{display:block}"
    ".lissome-live>.lissome-print{display:none}"
    "@media print{.lissome-live>.lissome-screen{display:none}"
    ".lissome-live>.lissome-print{display:block}}"
    ".lissome-touch{display:none;position:absolute;z-index:2;left:0;top:0;min-height:44px;"
    "padding:0 .9em;border:1px solid currentColor;border-radius:.4em;font:inherit;font-size:.85em;"
    "color:inherit;background:var(--pst-color-background,Canvas)}"
    "@media (any-pointer:coarse){.lissome-touch{display:block}}"
    "@media (pointer:coarse){.lissome-screen .modebar-container{display:none}}"
    ".lissome-loose{outline:2px solid var(--pst-color-primary,#0a6bb0)}"
    ".lissome-loose .gl-container{touch-action:none}"
    ".lissome-slide{display:flex;align-items:center;gap:.8em;padding:0 .4em}"
    ".lissome-slide>label,.lissome-slide>output{white-space:nowrap}"
    ".lissome-slide>output{min-width:3em;font-variant-numeric:tabular-nums}"
    ".lissome-slide>input{flex:1;min-width:0;height:44px;cursor:pointer;"
    "accent-color:var(--pst-color-primary,#0a6bb0)}"
    "</style>"
)

SCRIPT = """
(function () {
  "use strict";
  var plot = document.getElementById("NAME"), frame = plot.closest(".lissome-drawing");
  var given = JSON.parse(document.getElementById("NAME-data").textContent);
  var button = document.getElementById("NAME-touch"), bar = document.getElementById("NAME-slide");
  var TURN = Math.PI / 24;

  function begin() {
    frame.classList.toggle("lissome-live", Boolean(window.Plotly));
    if (!window.Plotly) return;  // a notebook without plotly.js: the twin is enough
    var watch = new IntersectionObserver(function (seen) {
      if (!seen.some(function (one) { return one.isIntersecting; })) return;
      watch.disconnect();
      Plotly.newPlot(plot, given.data, given.layout, given.config).then(come_alive);
    }, {rootMargin: "600px 0px"});
    watch.observe(plot);
  }

  function scenes() {
    return Object.keys(plot._fullLayout || {}).filter(function (key) {
      return /^scene[0-9]*$/.test(key);
    });
  }

  // Axes and text take the color of the page's own text, also after the reader turns the theme.
  function paint() {
    var ink = getComputedStyle(plot).color, change = {"font.color": ink};
    scenes().forEach(function (scene) {
      ["xaxis", "yaxis", "zaxis"].forEach(function (axis) {
        change[scene + "." + axis + ".color"] = ink;
        change[scene + "." + axis + ".gridcolor"] = "rgba(128,136,146,0.45)";
      });
    });
    Plotly.relayout(plot, change);
  }

  function look(round, high, near) {
    var change = {};
    scenes().forEach(function (scene) {
      var eye = plot._fullLayout[scene]._scene.getCamera().eye;
      var far = Math.hypot(eye.x, eye.y, eye.z), way = Math.atan2(eye.y, eye.x) + round;
      var up = Math.max(-1.5, Math.min(1.5, Math.asin(eye.z / far) + high));
      far = Math.max(0.2, Math.min(8, far * near));
      change[scene + ".camera.eye"] = {x: far * Math.cos(up) * Math.cos(way),
        y: far * Math.cos(up) * Math.sin(way), z: far * Math.sin(up)};
    });
    Plotly.relayout(plot, change);
  }

  // What the mouse does can be done from the keyboard: turn, zoom, move the slider.
  var moves = {ArrowLeft: [-TURN, 0, 1], ArrowRight: [TURN, 0, 1], ArrowUp: [0, TURN, 1],
    ArrowDown: [0, -TURN, 1], "+": [0, 0, 0.9], "-": [0, 0, 1 / 0.9]};
  function press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (moves[event.key]) look.apply(null, moves[event.key]);
    else if (bar && (event.key === "," || event.key === ".")) {
      bar.value = Number(bar.value) + (event.key === "." ? 1 : -1);
      slide();
    } else return;
    event.preventDefault();
  }

  var asked = 0;
  function slide() {
    var step = given.steps[bar.value];
    bar.nextElementSibling.textContent = step.label;
    bar.setAttribute("aria-valuetext", step.label);
    cancelAnimationFrame(asked);  // a finger is faster than a surface
    asked = requestAnimationFrame(function () {
      Plotly[step.method].apply(null, [plot].concat(step.args));
    });
  }

  // A finger scrolls the page, also where it meets a figure. A tap, or the button, lets the figure
  // loose: one finger then turns it and two zoom. The next tap, or a touch elsewhere, holds it.
  var loose = false, start = null, span = 0;
  function let_loose(now) {
    loose = now;
    button.textContent = loose ? "Tap to scroll" : "Tap to turn";
    plot.classList.toggle("lissome-loose", loose);
  }
  function apart(touches) {
    return Math.hypot(touches[0].clientX - touches[1].clientX,
      touches[0].clientY - touches[1].clientY);
  }
  function touch(event) {
    if (!event.target.closest(".gl-container, .nsewdrag")) return;
    var finger = event.changedTouches[0], two = event.touches.length > 1;
    if (event.type === "touchstart") {
      start = two ? null : {x: finger.clientX, y: finger.clientY, at: event.timeStamp};
      span = two ? apart(event.touches) : 0;
    } else if (event.type === "touchend" && start && event.timeStamp - start.at < 500 &&
        Math.hypot(finger.clientX - start.x, finger.clientY - start.y) < 10) {
      let_loose(!loose);
      event.preventDefault();  // no mouse follows
      event.stopPropagation();
      return;
    }
    if (!loose) event.stopPropagation();  // plotly would keep the page from scrolling
    else if (two || span) {
      event.stopPropagation();
      if (two) {
        event.preventDefault();
        var now = apart(event.touches);
        look(0, 0, span / now);
        span = now;
      }
      if (!event.touches.length) span = 0;
    } else if (event.type === "touchend") setTimeout(look, 0, 0, 0, 1);  // plotly forgets otherwise
  }

  function come_alive() {
    plot.tabIndex = 0;
    plot.addEventListener("keydown", press);
    plot.addEventListener("wheel", function (event) {  // without control the wheel scrolls the page
      if (!event.ctrlKey) event.stopPropagation();
    }, {capture: true, passive: true});
    ["touchstart", "touchmove", "touchend"].forEach(function (kind) {
      plot.addEventListener(kind, touch, {capture: true, passive: false});
    });
    document.addEventListener("touchstart", function (event) {
      if (loose && !frame.contains(event.target)) let_loose(false);
    }, {passive: true});
    button.addEventListener("click", function () { let_loose(!loose); });
    if (bar) bar.addEventListener("input", slide);
    new MutationObserver(paint).observe(document.documentElement,
      {attributes: true, attributeFilter: ["data-theme"]});
    paint();
  }

  // Where plotly.js is on its way, the page keeps the room of the figure, and nothing jumps.
  if (document.querySelector("script[src*=plotly]")) frame.classList.add("lissome-live");
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", begin);
  else begin();
})();
"""
