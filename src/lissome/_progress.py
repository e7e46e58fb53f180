"""Progress bars of long work, alike everywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .errors import InvalidInput

if TYPE_CHECKING:
    from tqdm import tqdm

__all__ = ["bar"]

_DELAY = 2.0  # seconds: what ends sooner shows nothing


def bar(
    label: str,
    progress: bool | None,
    total: float | None = None,
    *,
    initial: float = 0,
    unit: str = "it",
    delay: float | None = None,
) -> tqdm[Any]:
    """Return a progress bar on stderr, a context manager; its attribute `disable` says if it is none.

    Parameters
    ----------
    label : str
        What is being done.
    progress : bool or None
        Whether to show it; None: only if stderr is a terminal.
    total, initial : float, optional
        What there is to do, and what is done already. Without a total the bar counts.
    unit : str
        What is counted.
    delay : float, optional
        Seconds before which nothing is shown; by default short work shows nothing.

    Raises
    ------
    InvalidInput
        If `progress` is something else.
    """
    from tqdm import tqdm

    if progress is not None and not isinstance(progress, bool):
        raise InvalidInput(
            f"argument `progress` is {progress!r}; pass True, False, or None for a bar on terminals only"
        )
    shown = None
    if isinstance(total, float):
        shown = "{l_bar}{bar}| {n:.4g} of {total:.4g} [{elapsed}<{remaining}]"
    return tqdm(
        total=total, initial=initial, desc=label, unit=unit, bar_format=shown,
        delay=_DELAY if delay is None else delay,
        disable=None if progress is None else not progress,  # tqdm's None: only on a terminal
    )  # fmt: skip
