"""What a judge is made of: the facts that it needs, and the checks that decide.

A judge is a pure function from recorded facts to checks. Pages record facts only; nothing that a
page says can change a verdict except the numbers themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import literature
from .._datapackage import nearest
from .._digits import rounded
from .._validate import finite, finite_array
from ..errors import InvalidInput

if TYPE_CHECKING:
    from ..scoreboard import Claim

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

__all__ = [
    "Check",
    "Facts",
    "Judge",
    "Need",
    "Outcome",
    "agrees_with_measurement",
    "all_above",
    "all_below",
    "decreasing",
    "flag",
    "flags",
    "for_every_reading",
    "holds",
    "increasing",
    "judge",
    "listed",
    "number",
    "numbers",
    "optional",
    "order_of",
    "short",
    "within",
    "within_percent",
]


class Outcome(Enum):
    """What a check says.

    Examples
    --------
    A check may also find that a reading of the text decides, or that measured data are not there:

    >>> from lissome.judges import Outcome
    >>> [outcome.value for outcome in Outcome]
    ['holds', 'fails', 'undetermined', 'awaits']
    """

    HOLDS = "holds"
    FAILS = "fails"
    UNDETERMINED = "undetermined"  # true for some readings of the text and false for others
    AWAITS = "awaits"  # the measured data are not there


@dataclass(frozen=True)
class Check:
    """One check: its outcome and a sentence that says it.

    Attributes
    ----------
    outcome : Outcome
        Whether it holds.
    sentence : str
        What was checked and found, for the reader. Empty if another sentence of the same judge
        says it as well.

    Examples
    --------
    >>> from lissome.judges import Check, Outcome
    >>> Check(Outcome.HOLDS, "three equilibria below the limit pressure").outcome.value
    'holds'
    """

    outcome: Outcome
    sentence: str


@dataclass(frozen=True)
class Need:
    """A fact that a judge needs.

    Attributes
    ----------
    kind : {'number', 'numbers', 'flag', 'flags'}
        What is recorded: a finite number, a list of them, true or false, a list of those.
    meaning : str
        What it is, with its unit.
    required : bool
        Whether it must be there; others only add to the sentence.

    Examples
    --------
    >>> from lissome.judges import JUDGES
    >>> JUDGES["strip-best-angle-095"].needs["value"]
    Need(kind='number', meaning='angle of the greatest frequency, degrees', required=True)
    """

    kind: str
    meaning: str
    required: bool = True


def number(meaning: str) -> Need:
    """Need a finite number."""
    return Need("number", meaning)


def numbers(meaning: str) -> Need:
    """Need a list of finite numbers."""
    return Need("numbers", meaning)


def flag(meaning: str) -> Need:
    """Need true or false."""
    return Need("flag", meaning)


def flags(meaning: str) -> Need:
    """Need a list of true or false."""
    return Need("flags", meaning)


def optional(need: Need) -> Need:
    """Accept a fact that only adds to the sentence."""
    return Need(need.kind, need.meaning, required=False)


Fact = float | bool | npt.NDArray[Any]


class Facts(Mapping[str, Any]):
    """Checked facts, with the uncertainty of the headline number (NaN where there is none).

    Parameters
    ----------
    facts : mapping of str to float, bool or ndarray
        What a page recorded, in canonical types.
    uncertainty : float
        Of the headline number.

    Examples
    --------
    >>> from lissome.judges import Facts
    >>> facts = Facts({"value": 65.13}, uncertainty=0.04)
    >>> facts["value"], facts.uncertainty
    (65.13, 0.04)
    """

    def __init__(self, facts: Mapping[str, Any], uncertainty: float) -> None:
        self._facts = MappingProxyType(dict(facts))
        self.uncertainty = uncertainty

    def __getitem__(self, name: str) -> Any:
        return self._facts[name]

    def __iter__(self) -> Any:
        return iter(self._facts)

    def __len__(self) -> int:
        return len(self._facts)


Decision = Callable[["Claim", Facts], Sequence[Check]]


@dataclass(frozen=True)
class Judge:
    """The test of one claim.

    Attributes
    ----------
    id : str
        The claim.
    needs : mapping of str to Need
        The facts that a page has to record. ``value`` is the headline number.
    decide : callable
        From claim and facts to checks; all must hold.

    Examples
    --------
    The same facts always lead to the same verdict; no page has a say in it:

    >>> from lissome.judges import JUDGES
    >>> from lissome.scoreboard import claims
    >>> judge = JUDGES["strip-best-angle-095"]
    >>> for angle in (65.1, 70.0):
    ...     facts = judge.checked("as_printed", {"value": angle, "spread": 0.2}, 0.04)
    ...     checks = judge.decide(claims()[judge.id], facts)
    ...     print(all(check.outcome.value == "holds" for check in checks))
    True
    False
    """

    id: str
    needs: Mapping[str, Need]
    decide: Decision

    @property
    def has_value(self) -> bool:
        """Whether the claim has a headline number, which then needs an uncertainty."""
        return "value" in self.needs

    def checked(self, argument: str, facts: object, uncertainty: float | None) -> Facts:
        """Return the facts in canonical types.

        Parameters
        ----------
        argument : str
            What they are called in messages.
        facts : mapping, or float
            What was recorded; a bare number stands for ``{"value": number}``.
        uncertainty : float or None
            Of the headline number.

        Raises
        ------
        InvalidInput
            If a fact is missing, unknown, of the wrong kind or not finite.
        """
        if not isinstance(facts, Mapping):
            if set(self._required()) - {"value"} or not self.has_value:
                raise InvalidInput(
                    f"argument `{argument}` is {facts!r}; the judge of '{self.id}' needs a mapping "
                    f"of facts:\n{self.describe()}"
                )
            facts = {"value": facts}
        missing = [name for name in self._required() if name not in facts]
        if missing:
            raise InvalidInput(
                f"argument `{argument}` lacks {', '.join(map(repr, missing))}; the judge of "
                f"'{self.id}' needs\n{self.describe()}"
            )
        for name in facts:
            if name not in self.needs:
                raise InvalidInput(
                    f"argument `{argument}` has {name!r}, which the judge of '{self.id}' does not "
                    f"know; {nearest(name, self.needs)}"
                )
        clean = {
            name: _clean(f"{argument}[{name!r}]", self.needs[name].kind, fact)
            for name, fact in facts.items()
        }
        return Facts(clean, float("nan") if uncertainty is None else uncertainty)

    def describe(self) -> str:
        """Return what has to be recorded, one fact a line."""
        return "\n".join(
            f"  {name} ({need.kind}{'' if need.required else ', may be left out'}): {need.meaning}"
            for name, need in self.needs.items()
        )

    def _required(self) -> list[str]:
        return [name for name, need in self.needs.items() if need.required]


def judge(id: str, /, **needs: Need) -> Callable[[Decision], Judge]:
    """Make a function the judge of a claim."""
    return lambda decide: Judge(id, MappingProxyType(needs), decide)


def _clean(argument: str, kind: str, fact: object) -> Fact:
    if kind == "number":
        return finite(argument, fact, largest=math.inf)
    if kind == "flag":
        if not isinstance(fact, (bool, np.bool_)):
            raise InvalidInput(f"argument `{argument}` is {fact!r}; pass True or False")
        return bool(fact)
    if kind == "numbers":
        values = finite_array(argument, fact, (None,))
    else:
        raw = np.asarray(fact)
        if raw.ndim != 1 or raw.dtype != bool:
            raise InvalidInput(f"argument `{argument}` is {fact!r}; pass a list of True and False")
        values = raw.copy()
    if len(values) == 0:
        raise InvalidInput(f"argument `{argument}` is empty; nothing can be judged by nothing")
    values.setflags(write=False)
    return values


def same_length(facts: Facts, *names: str) -> None:
    """Refuse lists that do not belong together."""
    lengths = {name: len(facts[name]) for name in names}
    if len(set(lengths.values())) > 1:
        raise InvalidInput(
            "the facts "
            + ", ".join(f"'{name}' ({length})" for name, length in lengths.items())
            + " have different lengths; give one entry for each case"
        )


# ------------------------------------------------------------------------------------- checks


def holds(condition: bool, sentence: str, otherwise: str | None = None) -> Check:
    """Check a condition.

    A sentence that only reports numbers stands for both outcomes; one that states the condition
    needs its negation in `otherwise`. An empty sentence says nothing: its condition is plain.
    """
    if condition:
        return Check(Outcome.HOLDS, sentence)
    return Check(Outcome.FAILS, sentence if otherwise is None else otherwise)


def short(value: float, digits: int = 2) -> str:
    """Return a number for the reader in a few digits, large and small ones as 7.9 × 10⁻¹⁴."""
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        text = f"{float(f'{value:.{digits - 1}e}'):.10f}".rstrip("0").rstrip(".")
    else:
        mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        text = f"10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
        text = text if mantissa == "1" else f"{mantissa} × {text}"
    return text.replace("-", "−")


def listed(values: Any, digits: int = 4, unit: str = "") -> str:
    """Return numbers as a person lists them, long lists by both ends."""
    texts = [short(value, digits) for value in np.asarray(values, dtype=float)]
    if len(texts) > 8:
        texts = [*texts[:3], "...", *texts[-3:]]
    tail = _spaced(unit)
    return (f"{', '.join(texts[:-1])} and {texts[-1]}" if len(texts) > 1 else texts[0]) + tail


def _spaced(unit: str) -> str:
    return unit if unit == "°" else f" {unit}" if unit not in ("", "1") else ""


def _decisive(name: str, spread: float, tolerance: float) -> None:
    if spread > tolerance:
        raise InvalidInput(
            f"argument `uncertainty` is {spread:.2g}, more than the tolerance {tolerance:.2g} on "
            f"{name}: such a number decides nothing; compute it more accurately"
        )


# In the checks below, `said` is the sentence while they hold: it may name the numbers found in
# braces, and the empty one says nothing. What fails always names its limit.


def within(
    name: str,
    value: float,
    target: float,
    tolerance: float,
    unit: str = "",
    spread: float = 0.0,
    said: str = "{name} is {value}, {distance} from {target}",
) -> Check:
    """Check that a number lies within an absolute tolerance of another.

    A number that is more uncertain than the tolerance is refused: it decides nothing.
    """
    _decisive(name, spread, tolerance)
    space = _spaced(unit)
    shown = rounded(value, spread or tolerance / 10, "unicode").replace("-", "−")
    distance = abs(value - target)
    found = {
        "name": name,
        "value": shown + space,
        "distance": short(distance) + space,
        "target": short(target, 6) + space,
    }
    return holds(
        distance <= tolerance,
        said.format(**found),
        "{name} is {value}, {distance} from {target}".format(**found)
        + f" (at most {short(tolerance, 6)}{space} allowed)",
    )


def within_percent(
    name: str,
    value: float,
    target: float,
    percent: float,
    spread: float = 0.0,
    said: str = "{name} is {value}, {distance} % from {target}",
) -> Check:
    """Check that a number lies within some per cent of another; see :func:`within`."""
    _decisive(name, spread, abs(target) * percent / 100)
    distance = 100 * abs(value / target - 1)
    shown = rounded(value, spread or abs(target) * percent / 1e4, "unicode").replace("-", "−")
    found = {
        "name": name,
        "value": shown,
        "distance": short(distance),
        "target": short(target, 6),
    }
    return holds(
        distance <= percent,
        said.format(**found),
        "{name} is {value}, {distance} % from {target}".format(**found)
        + f" (at most {short(percent, 6)} % allowed)",
    )


def all_below(
    name: str, values: Any, limit: float, unit: str = "", said: str = "{name} is {most}{value}"
) -> Check:
    """Check that the largest magnitude does not exceed a limit."""
    largest = float(np.max(np.abs(values)))
    space = _spaced(unit)
    most = "at most " if np.ndim(values) else ""
    value = short(largest) + space
    return holds(
        largest <= limit,
        said.format(name=name, most=most, value=value),
        f"{name} is {value}, above the limit of {short(limit, 6)}{space}",
    )


def all_above(
    name: str, values: Any, limit: float, unit: str = "", said: str = "{name} is {least}{value}"
) -> Check:
    """Check that the smallest value exceeds a limit."""
    smallest = float(np.min(values))
    space = _spaced(unit)
    least = "at least " if np.ndim(values) else ""
    value = short(smallest) + space
    return holds(
        smallest > limit,
        said.format(name=name, least=least, value=value),
        f"{name} is {value}, but must exceed {short(limit, 6)}{space}",
    )


def _at_least_two(name: str, values: Any) -> None:
    if len(values) < 2:
        raise InvalidInput(f"{name} has {len(values)} entries; a trend needs at least two")


def increasing(name: str, values: Any, said: str = "{name} rises from {first} to {last}") -> Check:
    """Check that a list of two or more strictly increases."""
    _at_least_two(name, values)
    return holds(
        bool(np.all(np.diff(values) > 0)),
        said.format(name=name, first=short(values[0], 3), last=short(values[-1], 3)),
        f"{name} does not increase strictly: {listed(values)}",
    )


def decreasing(name: str, values: Any, said: str = "{name} falls from {first} to {last}") -> Check:
    """Check that a list of two or more strictly decreases."""
    _at_least_two(name, values)
    return holds(
        bool(np.all(np.diff(values) < 0)),
        said.format(name=name, first=short(values[0], 3), last=short(values[-1], 3)),
        f"{name} does not decrease strictly: {listed(values)}",
    )


def for_every_reading(
    statement: str,
    readings: Any,
    outcomes: Any,
    symbol: str = "",
    otherwise: str = "",
    said: str | None = None,
) -> Check:
    """Check a statement for every value that a number left out by the text may have.

    True for all readings: it holds. For none: it fails. For some: the text does not determine it.
    `otherwise` is what happens instead, `said` the sentence if the statement holds for all.
    """
    true = np.asarray(outcomes, dtype=bool)
    values = np.asarray(readings, dtype=float)
    equals = f"{symbol} = " if symbol else ""
    if true.all():
        sentence = f"{statement} for {equals}{listed(values)}" if said is None else said
        return Check(Outcome.HOLDS, sentence)
    if not true.any():
        return Check(Outcome.FAILS, f"{statement} for none of {equals}{listed(values)}")
    contrary = f"for {equals}{listed(values[~true])} {otherwise}"
    if not otherwise:
        contrary = f"but not for {listed(values[~true])}"
    joint = "; " if otherwise else ", "
    return Check(
        Outcome.UNDETERMINED, f"{statement} for {equals}{listed(values[true])}{joint}{contrary}"
    )


def order_of(
    name: str,
    sizes: Any,
    errors: Any,
    least: float,
    said: str = "{name} vanishes at order {order}",
) -> Check:
    """Check that errors vanish with a size at least at a given order, to the nearest tenth.

    The order is the slope between the two smallest sizes in the log-log plane.
    """
    first, second = np.argsort(sizes)[:2]
    if (
        sizes[first] <= 0
        or sizes[first] == sizes[second]
        or min(errors[first], errors[second]) <= 0
    ):
        raise InvalidInput(
            f"an order of {name} needs two positive sizes and errors; got sizes {listed(sizes)} "
            f"and errors {listed(errors)}"
        )
    order = float(np.log(errors[second] / errors[first]) / np.log(sizes[second] / sizes[first]))
    return holds(
        order >= least - 0.05,
        said.format(name=name, order=f"{order:.2f}"),
        f"{name} vanishes at order {order:.2f} only (at least {short(least, 6)} expected)",
    )


def agrees_with_measurement(
    slot: str, facts: Facts, name: str, limit: float, what: str = "measured points"
) -> Check:
    """Check the deviation from measured points, or say that they are awaited.

    The fact `name` (optional in the judge) becomes compulsory when the slot is filled.
    """
    if not literature.is_available(slot):
        return Check(Outcome.AWAITS, f"the {what} are printed nowhere as numbers, and are awaited")
    if name not in facts:
        raise InvalidInput(f"the data '{slot}' are there: record '{name}', the deviation from them")
    return all_below(f"the deviation from the {what}", facts[name], limit)
