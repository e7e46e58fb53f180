"""Sphinx extension: what docstrings need to become pages of the reference.

A public name of the top level leads to the page of the module that defines it:
docstrings write ``:func:`lissome.equilibrate` `` or, in a module that imports it, plain
``:class:`DataError` ``, while the reference documents ``lissome.equilibrium.equilibrate``.
A name that a package shows as its own is documented once, there, and found from the module that
defines it.
Headings in the docstrings of modules become rubrics, since sections of one name on several pages
would be ambiguous as targets.

Listings of sources lead back to the reference. Sphinx takes all names of a module to be documented
under one prefix; those that are not (a package shows some of a module's names as its own) are found
here.
"""

from __future__ import annotations

import re

import lissome

UNDERLINE = re.compile(r"-{3,}\s*$")


def _headings_to_rubrics(app, what, name, obj, options, lines):
    if what != "module":
        return
    for i in reversed(range(1, len(lines))):
        if UNDERLINE.match(lines[i]) and lines[i - 1].strip():
            lines[i - 1 : i + 1] = ["", f".. rubric:: {lines[i - 1].strip()}", ""]


def of_package(module, name, documented):
    """Return the full name under which a package shows a name of one of its modules, or None."""
    parts = ["lissome", *filter(None, module.split(".")), *name.split(".")]
    shorter = (".".join(parts[:k] + parts[k + 1 :]) for k in reversed(range(1, len(parts) - 1)))
    return next((full for full in shorter if full in documented), None)


def _resolve(app, env, node, contnode):
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].removeprefix("lissome.")
    first, _, rest = name.partition(".")
    module = lissome._EXPORTS.get(first)
    domain = env.get_domain("py")
    if module is None:
        here = "" if name != node["reftarget"] else node.get("py:module") or ""
        target = of_package(here.removeprefix("lissome."), name, domain.objects)
    else:
        target = ".".join(filter(None, ["lissome", module, first, rest]))
    if target is None:
        return None
    return domain.resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], target, node, contnode
    )


def mended(body, module, documented):
    """Return a listing whose links to names that are not documented point to the module's own."""

    def link(match):
        if match[2] in documented:
            return match[0]
        parts = match[2].split(".")
        names = (".".join([module, *parts[k:]]) for k in range(1, len(parts)))
        return match[1] + next((name for name in names if name in documented), match[2])

    return re.sub(r'(class="viewcode-back" href="[^"#]*#)([^"]+)', link, body)


def _mend_links_back(app, pagename, templatename, context, doctree):
    if pagename.startswith("_modules/") and "body" in context:
        module = pagename.removeprefix("_modules/").replace("/", ".")
        documented = app.env.get_domain("py").objects
        context["body"] = mended(context["body"], module, documented)


def setup(app):
    app.connect("html-page-context", _mend_links_back)
    app.connect("missing-reference", _resolve)
    app.connect("autodoc-process-docstring", _headings_to_rubrics)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
