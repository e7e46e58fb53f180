"""Sphinx extension: the built book asks nothing of a network.

MathJax comes from the package ``sphinx-mathjax-offline`` and plotly.js from plotly itself. Both are
copied into the built ``_static``, never into the source tree; plotly.js goes only to pages that
hold a figure. Every executed page is offered as notebook, script and source, and the theme's hooks
for live kernels, which would need a network, are taken out.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path

import jupytext

#: What MathJax's ``tex-chtml`` bundle may load at run time; the rest of the package is 17 MB more.
MATHJAX_PARTS = ("tex-chtml.js", "output/chtml/fonts", "input/tex/extensions", "ui", "a11y", "sre")

#: plotly writes this class on every figure it renders to HTML.
PLOTLY_MARK = "plotly-graph-div"


def _package(name):
    spec = importlib.util.find_spec(name)
    if spec is None:
        raise RuntimeError(f"package {name!r} is missing: `make env` installs it")
    return Path(spec.origin).parent


def _executed(app, pagename):
    return Path(app.outdir).parent / "jupyter_execute" / f"{pagename}.ipynb"


def _without_live_kernels(app):
    """Silence sphinx-thebe, which Jupyter Book always loads: it declares its constants twice."""
    for name, listeners in app.events.listeners.items():
        kept = [entry for entry in listeners if entry.handler.__module__ != "sphinx_thebe"]
        app.events.listeners[name] = kept


def _plotly_where_needed(app, pagename, templatename, context, doctree):
    if PLOTLY_MARK in (context.get("body") or ""):
        app.add_js_file("plotly.min.js", loading_method="defer")
        app.env.lissome_needs_plotly = True


def _announce_notebook(app, pagename, templatename, context, doctree):
    """Runs before the theme makes its download menu."""
    if _executed(app, pagename).is_file():
        context["ipynb_source"] = f"{pagename}.ipynb"


def _offer_script(app, pagename, templatename, context, doctree):
    """Runs after the theme made its download menu: adds the notebook as a Python script."""
    if not _executed(app, pagename).is_file():
        return
    for group in context.get("header_buttons", []):
        if group.get("label") == "download-buttons":
            script = {
                "type": "link",
                "url": f"{context['pathto']('_sources', 1)}/{pagename}.py",
                "text": ".py",
                "icon": "fab fa-python",
                "tooltip": "Download as a Python script",
                "label": "download-script-button",
            }
            group["buttons"].insert(1, script)


def _download(notebook):
    """Return an executed notebook as it is offered: pictures as PNG, not as HTML beside it.

    The HTML of a drawing follows the theme of a page, or needs a script that the page loads.
    """
    content = json.loads(notebook.read_text(encoding="utf-8"))
    for cell in content["cells"]:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                data.pop("text/html", None)
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _copy(app, error):
    if error is not None or app.builder.format != "html":
        return
    static = Path(app.outdir) / "_static"
    source = _package("sphinx-mathjax-offline") / "static" / "mathjax"
    for part in MATHJAX_PARTS:
        origin, target = source / part, static / "mathjax" / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if origin.is_dir():
            shutil.copytree(origin, target, dirs_exist_ok=True)
        else:
            shutil.copy2(origin, target)
    if getattr(app.env, "lissome_needs_plotly", False):
        shutil.copy2(_package("plotly") / "package_data" / "plotly.min.js", static)
    for path in static.rglob("*.map"):  # for those who debug the theme's scripts
        path.unlink()
    for page in sorted(app.env.found_docs):
        notebook = _executed(app, page)
        if notebook.is_file():
            target = Path(app.outdir) / "_sources" / page
            target.parent.mkdir(parents=True, exist_ok=True)
            Path(f"{target}.ipynb").write_text(_download(notebook), encoding="utf-8")
            jupytext.write(jupytext.read(app.env.doc2path(page)), f"{target}.py", fmt="py:percent")


def setup(app):
    app.config.mathjax_path = "mathjax/tex-chtml.js"
    app.connect("builder-inited", _without_live_kernels)
    app.connect("html-page-context", _plotly_where_needed)
    app.connect("html-page-context", _announce_notebook, priority=100)
    app.connect("html-page-context", _offer_script, priority=600)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
