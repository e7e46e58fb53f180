"""Claims of the thesis against computed values.

Pages of the book record facts, and the test named in ``data/claims.csv`` decides: every claim has a
judge (:mod:`lissome.judges`), a pure function from recorded facts to a verdict with its reason. A
page cannot state a verdict.

During a build of the book the environment variable ``LISSOME_SCOREBOARD`` names the folder that
takes the records, one JSON file for each claim, and ``LISSOME_PAGE`` the page that is running. When
a notebook is run by hand neither is set: :func:`record` then judges and shows the result, and
leaves nothing behind.

Examples
--------
>>> from lissome import scoreboard
>>> result = scoreboard.record("strip-best-angle-095", as_printed={"value": 65.13, "spread": 0.2},
...                            uncertainty=0.04, independent=(65.12, 0.02))
>>> result.verdict.value, result.computed()
('reproduced', '65.13(4)')
>>> print(scoreboard.needs("strip-best-angle-095"))
  value (number): angle of the greatest frequency, degrees
  spread (number): difference of the largest and the least best angle over Lambda, degrees
  intensities (numbers, may be left out): the Lambda over which the spread is taken
"""

from __future__ import annotations

import csv
import html
import io
import json
import math
import os
import uuid
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from . import literature
from ._datapackage import nearest, write_atomically
from ._digits import rounded, with_uncertainty
from ._validate import finite, nonnegative
from .errors import DataError, InvalidInput
from .judges import JUDGES, Check, Outcome

__all__ = ["Board", "Claim", "Record", "Row", "Verdict", "board", "claims", "needs", "record"]

FOLDER_VARIABLE = "LISSOME_SCOREBOARD"
PAGE_VARIABLE = "LISSOME_PAGE"
_FORMAT = 1
_PROCESS = uuid.uuid4().hex  # tells a cell that is run twice from a page that is run again


class Verdict(Enum):
    """What comes out of a claim.

    Examples
    --------
    >>> from lissome.scoreboard import Verdict
    >>> [verdict.glyph for verdict in (Verdict.REPRODUCED, Verdict.DIFFERS)]
    ['✓', '≠']
    """

    REPRODUCED = "reproduced"
    CORRECTED = "reproduced after correction"
    DIFFERS = "differs"
    UNDETERMINED = "not determined by the text"
    AWAITS = "awaits data"
    PENDING = "pending"

    @property
    def glyph(self) -> str:
        """One character that tells the verdict without color."""
        return _GLYPHS[self.name]


_GLYPHS = {
    "REPRODUCED": "✓",
    "CORRECTED": "✎",
    "DIFFERS": "≠",
    "UNDETERMINED": "?",
    "AWAITS": "…",
    "PENDING": "○",
}


@dataclass(frozen=True)
class Claim:
    """A claim of the thesis, as it stands in ``data/claims.csv``.

    Attributes
    ----------
    id, chapter, place : str
        Name, chapter, and equation, figure or section of the thesis.
    page : str
        The page of the book that records the result.
    kind : str
        number, trend, exact, curve, measurement, derivation, speed or picture.
    text : str
        What is claimed.
    printed : str
        The printed value or values, as characters; empty for a claim without one.
    value : float
        The printed value (NaN if the claim is not one number).
    unit : str
        Unit of the value; ``1`` or empty if it has none.
    test : str
        What decides, in words.
    note : str
        Remark.
    data : tuple of str
        Stored numbers that belong to the claim (:func:`lissome.literature.value`).
    slot : str
        Awaited measurements that belong to the claim; empty if there are none.

    Examples
    --------
    >>> from lissome import scoreboard
    >>> claim = scoreboard.claims()["lambda-typical"]
    >>> claim.kind, claim.printed, claim.number, claim.unit
    ('number', '2.9', 2.9, '1')
    """

    id: str
    chapter: str
    place: str
    page: str
    kind: str
    text: str
    printed: str
    value: float
    unit: str
    test: str
    note: str
    data: tuple[str, ...]
    slot: str

    @property
    def number(self) -> float:
        """The printed value.

        Raises
        ------
        DataError
            If the claim has none.
        """
        if math.isnan(self.value):
            raise DataError(f"the claim '{self.id}' has no printed value in claims.csv")
        return self.value


def claims() -> dict[str, Claim]:
    """Return every claim by its id.

    Examples
    --------
    >>> from lissome import scoreboard
    >>> scoreboard.claims()["lambda-typical"].place
    'Table 3.1, (3.14)'
    """
    columns = literature.load("claims").columns
    found = {}
    for index, id in enumerate(columns["id"]):
        row = {name: column[index] for name, column in columns.items()}
        row["text"] = row.pop("claim")
        row["data"] = tuple(row["data"].split())
        row["value"] = float(row["value"])
        found[id] = Claim(**row)
    return found


def _claim(claim_id: object) -> Claim:
    known = claims()
    if not isinstance(claim_id, str) or claim_id not in known:
        raise InvalidInput(
            f"argument `claim` is {claim_id!r}; there is no such claim: {nearest(claim_id, known)}"
        )
    return known[claim_id]


def needs(claim: str) -> str:
    """Return what a page has to record for a claim, one fact a line.

    Parameters
    ----------
    claim : str
        Id of the claim.

    Returns
    -------
    str

    Raises
    ------
    InvalidInput
        If there is no such claim, or nobody has written its judge yet.

    Examples
    --------
    >>> from lissome import scoreboard
    >>> print(scoreboard.needs("strip-best-angle-095").splitlines()[0])
      value (number): angle of the greatest frequency, degrees
    """
    return _judge(_claim(claim)).describe()


def _judge(claim: Claim) -> Any:
    try:
        return JUDGES[claim.id]
    except KeyError:
        raise InvalidInput(
            f"the claim '{claim.id}' has no judge yet; write the test '{claim.test}' as a function "
            "in a module of lissome.judges"
        ) from None


@dataclass(frozen=True)
class Record:
    """Recorded facts of one claim, and the verdict that follows from them.

    Attributes
    ----------
    claim : Claim
        The claim.
    page : str
        The page that recorded the facts; empty outside a build.
    as_printed, corrected : mapping or None
        Facts with the formulas and numbers of the thesis as printed, and as corrected.
    independent : (float, float) or None
        The headline number by an independent method, and its uncertainty.
    uncertainty : float or None
        Uncertainty of the headline number.
    correction : str
        What is corrected.
    remark : str
        A sentence for the reader.

    Examples
    --------
    The verdict follows from the numbers; no digit is shown beyond their uncertainty:

    >>> from lissome import scoreboard
    >>> facts = {"value": 65.13, "spread": 0.2}
    >>> record = scoreboard.record("strip-best-angle-095", as_printed=facts, uncertainty=0.04)
    >>> record.verdict.name, record.computed(), record.difference()
    ('REPRODUCED', '65.13(4)', '0.03')
    """

    claim: Claim
    page: str
    as_printed: Mapping[str, Any] | None
    corrected: Mapping[str, Any] | None
    independent: tuple[float, float] | None
    uncertainty: float | None
    correction: str
    remark: str

    def _checks(self, facts: Mapping[str, Any] | None) -> tuple[Check, ...]:
        if facts is None:
            return ()
        judge = _judge(self.claim)
        argument = "corrected" if facts is self.corrected else "as_printed"
        return tuple(judge.decide(self.claim, judge.checked(argument, facts, self.uncertainty)))

    @property
    def checks(self) -> tuple[Check, ...]:
        """The checks that decide: of the corrected facts if there are any."""
        return self._checks(self.as_printed if self.corrected is None else self.corrected)

    @property
    def verdict(self) -> Verdict:
        """The verdict, computed by the judge of the claim."""
        outcomes = {check.outcome for check in self.checks}
        if Outcome.FAILS in outcomes:
            return Verdict.DIFFERS
        if Outcome.UNDETERMINED in outcomes:
            return Verdict.UNDETERMINED
        if Outcome.AWAITS in outcomes:
            return Verdict.AWAITS
        if self.corrected is None:
            return Verdict.REPRODUCED
        printed = self._checks(self.as_printed)
        if printed and all(check.outcome is Outcome.HOLDS for check in printed):
            return Verdict.REPRODUCED
        return Verdict.CORRECTED

    @property
    def why(self) -> str:
        """The reason of the verdict, in sentences: what failed, or what held and what is awaited."""
        open_ = self.verdict in (Verdict.DIFFERS, Verdict.UNDETERMINED)
        first = (Outcome.FAILS, Outcome.UNDETERMINED) if open_ else (Outcome.HOLDS,)
        checks = self.checks
        parts = [c.sentence for o in (*first, Outcome.AWAITS) for c in checks if c.outcome is o]
        if self.corrected is not None:
            parts.insert(0, f"corrected: {self.correction}")
        return " ".join(_as_sentence(part) for part in (*parts, self.remark) if part)

    @property
    def value(self) -> float | None:
        """The headline number that decides, if the claim has one."""
        facts = self.as_printed if self.corrected is None else self.corrected
        return None if facts is None or "value" not in facts else float(facts["value"])

    def computed(self, style: str = "text") -> str:
        """Return the headline number with its uncertainty; empty if the claim has none.

        Parameters
        ----------
        style : {"text", "unicode", "latex"}
            How powers of ten are written.
        """
        if self.value is None or self.uncertainty is None:
            return ""
        return with_uncertainty(self.value, self.uncertainty, style)

    def independently(self, style: str = "text") -> str:
        """Return the number of the independent method with its uncertainty, or nothing.

        Parameters
        ----------
        style : {"text", "unicode", "latex"}
            How powers of ten are written.
        """
        return "" if self.independent is None else with_uncertainty(*self.independent, style)

    def difference(self, style: str = "text") -> str:
        """Return computed minus printed, rounded where the uncertainty begins, or nothing.

        Parameters
        ----------
        style : {"text", "unicode", "latex"}
            How powers of ten are written.
        """
        if self.value is None or self.uncertainty is None or math.isnan(self.claim.value):
            return ""
        return rounded(self.value - self.claim.value, self.uncertainty, style)

    def __repr__(self) -> str:
        return f"{self.verdict.value}: {_as_sentence(self.claim.text)} {self.why}"

    def _repr_html_(self) -> str:
        name = self.verdict.name.lower()
        return (
            f'<p><span class="verdict verdict-{name}">{self.verdict.glyph}&nbsp;'
            f"{html.escape(self.verdict.value)}</span> "
            f"{html.escape(_as_sentence(self.claim.text))}<br>{html.escape(self.why)}</p>"
        )


def _as_sentence(text: str) -> str:
    """Begin with a capital, unless with a symbol, and end with a point."""
    first = text.split(" ", 1)[0].rstrip(".,:;").replace("-", "")
    if first == "a" or (len(first) > 1 and first.isascii() and first.isalpha()):
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "?")) else f"{text}."


def record(
    claim: str,
    *,
    as_printed: Mapping[str, Any] | float | None = None,
    corrected: Mapping[str, Any] | float | None = None,
    independent: tuple[float, float] | float | None = None,
    uncertainty: float | None = None,
    correction: str = "",
    remark: str = "",
) -> Record:
    """Record what came out of a claim; the verdict is computed from it.

    Parameters
    ----------
    claim : str
        Id of the claim in ``data/claims.csv``.
    as_printed : mapping or float, optional
        The facts that the judge needs (:func:`needs` lists them), computed with the formulas and
        numbers of the thesis as printed. A bare number stands for ``{"value": number}``.
    corrected : mapping or float, optional
        The same where the formula or an input of the thesis had to be corrected. At least one of
        the two is needed.
    independent : (float, float) or float, optional
        The headline number by an independent method and its uncertainty (that of the computed one
        by default). Numbers that exclude each other are refused: one of them is wrong.
    uncertainty : float, optional
        Uncertainty of the headline number ``value`` in its unit, needed where there is one; 0 only
        for a number that is exact.
    correction : str, optional
        What is corrected; needed with `corrected`.
    remark : str, optional
        A sentence that is shown with the verdict.

    Returns
    -------
    Record
        With ``verdict`` and ``why``; a notebook shows both.

    Raises
    ------
    InvalidInput
        If the claim is unknown, has no judge or belongs to another page, if a fact is missing,
        unknown, of the wrong kind or not finite, if the independent number contradicts the
        computed one, or if the claim has been recorded before in this build.

    Examples
    --------
    A number without its uncertainty is refused:

    >>> from lissome import scoreboard
    >>> scoreboard.record("strip-best-angle-095", as_printed={"value": 65.13, "spread": 0.2})
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `uncertainty` is missing; ...
    """
    about = _claim(claim)
    judge = _judge(about)
    if as_printed is None and corrected is None:
        raise InvalidInput(
            f"the record of '{claim}' is empty; give `as_printed` or `corrected`:\n"
            f"{judge.describe()}"
        )
    if (corrected is not None) != bool(correction.strip()):
        raise InvalidInput(
            "arguments `corrected` and `correction` go together: give both, the facts and what "
            "was corrected in words, or none"
        )
    spread = _uncertainty(judge, uncertainty)
    clean = {
        name: None if facts is None else _plain(judge.checked(name, facts, spread))
        for name, facts in (("as_printed", as_printed), ("corrected", corrected))
    }
    result = Record(
        claim=about,
        page=os.environ.get(PAGE_VARIABLE, ""),
        as_printed=clean["as_printed"],
        corrected=clean["corrected"],
        independent=_independent(independent, spread),
        uncertainty=spread,
        correction=correction.strip(),
        remark=remark.strip(),
    )
    _consistent(result)
    _ = result.why  # the judge must be able to decide
    if result.page and result.page != about.page:
        raise InvalidInput(
            f"the claim '{claim}' belongs to the page '{about.page}', but is recorded on "
            f"'{result.page}'; record it there, or change the column `page` of claims.csv"
        )
    folder = os.environ.get(FOLDER_VARIABLE)
    if folder:
        _store(Path(folder), result)
    return result


def _uncertainty(judge: Any, uncertainty: float | None) -> float | None:
    if uncertainty is not None:
        return nonnegative("uncertainty", uncertainty, largest=math.inf)
    if judge.has_value:
        raise InvalidInput(
            f"argument `uncertainty` is missing; '{judge.id}' has a headline number, and no digit "
            "is shown beyond its uncertainty (0 only for an exact number)"
        )
    return None


def _independent(given: object, spread: float | None) -> tuple[float, float] | None:
    if given is None:
        return None
    if isinstance(given, Sequence) and not isinstance(given, str):
        if len(given) != 2:
            raise InvalidInput(
                f"argument `independent` is {given!r}; give (number, uncertainty) or one number"
            )
        first = finite("independent", given[0], largest=math.inf)
        return first, nonnegative("independent", given[1], largest=math.inf)
    number = finite("independent", given, largest=math.inf)
    if spread is None:
        raise InvalidInput(
            "argument `independent` has no uncertainty; give (number, uncertainty) or `uncertainty`"
        )
    return number, spread


def _consistent(result: Record) -> None:
    if result.independent is None:
        return
    if result.value is None or result.uncertainty is None:
        raise InvalidInput(
            "argument `independent` is compared with the fact 'value', which is not recorded"
        )
    other, spread = result.independent
    # 1e-14: the rounding of two numbers that are both called exact
    allowed = 2 * (spread + result.uncertainty) + 1e-14 * abs(other)
    if abs(other - result.value) > allowed:
        raise InvalidInput(
            f"argument `independent` is {other!r} +- {spread:.2g}, but the computed value is "
            f"{result.value!r} +- {result.uncertainty:.2g}: they exclude each other, so at least "
            "one of them is wrong or more uncertain than stated"
        )


def _plain(facts: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: fact.tolist() if isinstance(fact, np.ndarray) else fact
        for name, fact in facts.items()
    }


def _store(folder: Path, result: Record) -> None:
    path = folder / f"{result.claim.id}.json"
    if path.is_file():
        before = _read_json(path)
        if before["page"] != result.page:
            raise InvalidInput(
                f"the claim '{result.claim.id}' was recorded by the page '{before['page']}' "
                "already; a claim is recorded once"
            )
        if result.page and before["process"] == _PROCESS:
            raise InvalidInput(
                f"the claim '{result.claim.id}' is recorded twice on the page '{result.page}'; "
                "a claim is recorded once"
            )
    content = {
        "format": _FORMAT,
        "claim": result.claim.id,
        "page": result.page,
        "process": _PROCESS,
        "as_printed": result.as_printed,
        "corrected": result.corrected,
        "independent": result.independent,
        "uncertainty": result.uncertainty,
        "correction": result.correction,
        "remark": result.remark,
    }
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    write_atomically(path, text.encode("utf-8"))


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != _FORMAT or content["claim"] != path.stem:
            raise ValueError(f"format {content['format']!r} of the claim {content['claim']!r}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path}: expected the record of a claim, found {type(error).__name__}: {error}; "
            "build the book anew"
        ) from error
    return dict(content)


def _read(path: Path) -> Record:
    content = _read_json(path)
    independent = content["independent"]
    try:
        return Record(
            claim=_claim(content["claim"]),
            page=content["page"],
            as_printed=content["as_printed"],
            corrected=content["corrected"],
            independent=None if independent is None else (independent[0], independent[1]),
            uncertainty=content["uncertainty"],
            correction=content["correction"],
            remark=content["remark"],
        )
    except KeyError as error:
        raise DataError(f"{path}: the record lacks {error}; build the book anew") from error


@dataclass(frozen=True)
class Row:
    """One line of the scoreboard: a claim and its record, if it has one.

    Attributes
    ----------
    claim : Claim
        The claim.
    record : Record or None
        What its page recorded.

    Examples
    --------
    A claim that no page has recorded is pending:

    >>> from lissome import scoreboard
    >>> row = scoreboard.Row(scoreboard.claims()["lambda-typical"], None)
    >>> row.verdict.value, row.why
    ('pending', '')
    """

    claim: Claim
    record: Record | None

    @property
    def verdict(self) -> Verdict:
        """The verdict; ``PENDING`` without a record."""
        return Verdict.PENDING if self.record is None else self.record.verdict

    @property
    def why(self) -> str:
        """The reason of the verdict."""
        return "" if self.record is None else self.record.why


@dataclass(frozen=True)
class Board:
    """All claims with their records.

    Attributes
    ----------
    rows : tuple of Row
        In the order of ``claims.csv``.
    missing : tuple of Claim
        Claims whose page is written but has recorded nothing: an error of the book.

    Examples
    --------
    >>> from lissome import scoreboard
    >>> empty = scoreboard.Board((), ())
    >>> sum(empty.counts().values()), empty.to_csv().splitlines()[0]
    (0, 'id,printed,computed,independent,difference,uncertainty,unit,verdict')
    """

    rows: tuple[Row, ...]
    missing: tuple[Claim, ...]

    def counts(self) -> dict[Verdict, int]:
        """Return how many claims have each verdict, also where it is 0."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in Verdict}

    def __getitem__(self, claim: str) -> Row:
        """Return the row of a claim."""
        about = _claim(claim)
        return next(row for row in self.rows if row.claim.id == about.id)

    def to_csv(self) -> str:
        """Return the scoreboard as CSV: one row a claim, no digit beyond its uncertainty."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        columns = ["id", "printed", "computed", "independent", "difference", "uncertainty"]
        writer.writerow([*columns, "unit", "verdict"])
        for row in self.rows:
            entry = row.record
            cells = ["", "", "", ""]
            if entry is not None:
                if entry.value is not None and entry.uncertainty is not None:
                    cells[0] = rounded(entry.value, entry.uncertainty)
                    cells[3] = _two_digits(entry.uncertainty)
                if entry.independent is not None:
                    cells[1] = rounded(*entry.independent)
                cells[2] = entry.difference()
            writer.writerow(
                [row.claim.id, row.claim.printed, *cells, row.claim.unit, row.verdict.value]
            )
        return stream.getvalue()


def _two_digits(uncertainty: float) -> str:
    return f"{uncertainty:.2g}"


def board(folder: str | os.PathLike[str], written: Collection[str]) -> Board:
    """Read all records of a build and judge them.

    Parameters
    ----------
    folder : path-like
        The folder of the records; it need not exist yet.
    written : collection of str
        The pages that the book holds: their claims must be recorded, others are pending.

    Returns
    -------
    Board

    Raises
    ------
    DataError
        If a record is damaged.

    Examples
    --------
    Before any page has run, all claims are pending, and those of written pages are missing:

    >>> import tempfile
    >>> from lissome import scoreboard
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     board = scoreboard.board(folder, written=["a-strain-gradients"])
    >>> board.counts()[scoreboard.Verdict.PENDING] == len(board.rows)
    True
    >>> {claim.page for claim in board.missing}
    {'a-strain-gradients'}
    """
    found = {path.stem: _read(path) for path in sorted(Path(folder).glob("*.json"))}
    rows = tuple(Row(claim, found.get(id)) for id, claim in claims().items())
    missing = tuple(row.claim for row in rows if row.record is None and row.claim.page in written)
    return Board(rows, missing)
