"""Sphinx extension: a public name of the top level leads to the page of the module that defines it.

Docstrings write ``:func:`lissome.equilibrate` `` or, in a module that imports it, plain
``:class:`DataError` ``, while the reference documents ``lissome.equilibrium.equilibrate``.
"""

from __future__ import annotations

import lissome


def _resolve(app, env, node, contnode):
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].removeprefix("lissome.")
    first, _, rest = name.partition(".")
    module = lissome._EXPORTS.get(first)
    if module is None:
        return None
    target = ".".join(filter(None, ["lissome", module, first, rest]))
    domain = env.get_domain("py")
    return domain.resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], target, node, contnode
    )


def setup(app):
    app.connect("missing-reference", _resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
