r"""What the pages of the book share, for notebooks: tables with numbers, words for a failed assertion.

A page asserts what its sentences say. Who changes a parameter and runs the page again meets such an
assertion sooner or later, and :func:`explain_assertions` says what it means.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from ._validate import one_of
from .errors import InvalidInput

__all__ = ["Table", "explain_assertions", "table"]

_ALIGNMENTS = {"left": ":---", "center": ":---:", "right": "---:"}
_NOTE = (
    "This assertion holds a statement of the page against the computation, for the parameters as they "
    "are printed there.\nAfter a change of parameters the statement need not hold: leave the assertion "
    "out, and read the computed numbers.\nIf nothing was changed, please report it."
)


@dataclass(frozen=True, eq=False)
class Table:
    """A numbered table: Markdown in the flavor of the book.

    Parameters
    ----------
    markdown : str
        The text.

    Examples
    --------
    >>> from lissome.notebook import Table
    >>> Table("| a |\\n| :---: |\\n| 1 |")
    | a |
    | :---: |
    | 1 |
    """

    markdown: str

    def __repr__(self) -> str:
        return self.markdown

    def _repr_markdown_(self) -> str:
        return self.markdown


def table(
    rows: Iterable[Sequence[Any]],
    header: Sequence[str],
    caption: str,
    name: str,
    align: Sequence[str] | None = None,
) -> Table:
    r"""Return a table with a number and a caption, as the last line of a cell shows it.

    Parameters
    ----------
    rows : iterable of sequences
        The cells, each of which is shown as ``str`` writes it; Markdown and formulas are set.
    header : sequence of str
        Titles of the columns.
    caption : str
        One line.
    name : str
        Label for references, like ``tab-widths``.
    align : sequence of {"left", "center", "right"}, optional
        Of the columns. By default a first column of words stands left, and all else is centered.

    Returns
    -------
    Table

    Raises
    ------
    InvalidInput
        If a row or `align` has not as many entries as the header, there are no rows, or caption or
        name cannot stand in a table.

    Examples
    --------
    >>> from lissome.notebook import table
    >>> table([(1, 2.5), (2, 3.5)], ("$n$", "value"), "Two values", "tab-values")
    :::{table} Two values
    :name: tab-values
    <BLANKLINE>
    | $n$ | value |
    | :---: | :---: |
    | 1 | 2.5 |
    | 2 | 3.5 |
    :::
    """
    titles = [str(title) for title in header]
    if not titles:
        raise InvalidInput("argument `header` is empty; give every column a title")
    if not caption.strip() or "\n" in caption:
        raise InvalidInput(f"argument `caption` is {caption!r}; write one line that is not empty")
    if not re.fullmatch(r"[a-z][a-z0-9-]*", name):
        raise InvalidInput(
            f"argument `name` is {name!r}; use lower-case letters, digits and hyphens: `tab-widths`"
        )
    cells = [[str(cell) for cell in row] for row in rows]
    if not cells:
        raise InvalidInput("argument `rows` is empty; a table needs at least one row")
    for i, row in enumerate(cells):
        if len(row) != len(titles):
            raise InvalidInput(
                f"argument `rows` has {len(row)} cells in row {i}, the header {len(titles)}; "
                "they must agree"
            )
    if align is None:
        sides = ["center"] * len(titles)
        if any(row[0][:1].isalpha() for row in cells):
            sides[0] = "left"
    else:
        sides = [one_of("align", side, tuple(_ALIGNMENTS)) for side in align]
    if len(sides) != len(titles):
        raise InvalidInput(
            f"argument `align` has {len(sides)} entries, the header {len(titles)}; they must agree"
        )
    lines = [titles, [_ALIGNMENTS[side] for side in sides], *cells]
    body = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return Table(f":::{{table}} {caption}\n:name: {name}\n\n{body}\n:::")


def explain_assertions() -> None:
    """Have failed assertions of this notebook or script say what they mean.

    The error stays what it is and stops the run as before; a note is added to it. Assertions that
    fail within a library are left alone. In IPython this takes the place of other handlers that were
    set with ``set_custom_exc``.

    Examples
    --------
    >>> from lissome.notebook import explain_assertions
    >>> explain_assertions()
    """
    shell = None
    if "IPython" in sys.modules:
        shell = sys.modules["IPython"].get_ipython()
    if shell is not None:
        shell.set_custom_exc((AssertionError,), _shown_in_notebook)
    elif sys.excepthook is not _shown_in_script:
        global _previous_hook  # the hook of the interpreter is one for the whole process, too
        _previous_hook, sys.excepthook = sys.excepthook, _shown_in_script


_previous_hook = sys.__excepthook__


def _noted(error: BaseException, trace: TracebackType | None) -> None:
    """Add the note to an assertion that was written in the notebook or script itself."""
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    here = trace is not None and trace.tb_frame.f_globals.get("__name__") == "__main__"
    if here and isinstance(error, AssertionError) and _NOTE not in getattr(error, "__notes__", ()):
        error.add_note(_NOTE)


def _shown_in_notebook(
    shell: Any, kind: type, error: BaseException, trace: TracebackType | None, tb_offset: Any = None
) -> None:
    _noted(error, trace)
    shell.showtraceback((kind, error, trace), tb_offset=tb_offset)


def _shown_in_script(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    _noted(error, trace)
    _previous_hook(kind, error, trace)
