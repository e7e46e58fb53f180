"""Branches in files: arrays and JSON, no pickle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ._branch_records import Event, Row, Settings
from ._corrector import Family
from ._stored import fits, pack_equilibria, unpack_equilibria
from .errors import DataError


def needed(meta: Mapping[str, Any], name: str, path: Any) -> Any:
    if name not in meta:
        raise DataError(f"the file {path} lacks {name!r}: it is damaged, or of another version")
    return meta[name]


def not_of_family(path: Any, parameter: float) -> DataError:
    return DataError(
        f"the file {path} holds a state that is no equilibrium of the family at parameter "
        f"{parameter:.8g}; pass the family that was followed, with the same mesh and constants"
    )


def settings_from(meta: Mapping[str, Any], path: Any) -> Settings:
    values = dict(needed(meta, "settings", path))
    try:
        values["report_at"] = tuple(values["report_at"])
        values["outputs"] = tuple(values["outputs"])
        return Settings(**values)
    except (KeyError, TypeError) as error:
        raise DataError(f"the settings in {path} are of another version: {error}") from error


def pack(
    rows: Sequence[Row], events: Sequence[Event], settings: Settings, finished: bool
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what a file of the branch holds: values for JSON, and arrays."""
    meta: dict[str, Any] = {
        "kind": "branch",
        "finished": finished,
        "settings": asdict(settings),
        "rows": [row.kind for row in rows],
        "events": [],
    }
    arrays: dict[str, Any] = {
        "parameter": np.array([row.parameter for row in rows]),
        "arclength": np.array([row.arclength for row in rows]),
        "smallest_eigenvalue": np.array([row.smallest_eigenvalue for row in rows]),
        "index": np.array([row.index for row in rows], dtype=int),
        "marginal": np.array([row.marginal for row in rows], dtype=bool),
        "outputs": np.array([[row.outputs[k] for k in settings.outputs] for row in rows]),
    }
    arrays |= pack_equilibria([row.equilibrium for row in rows])
    for i, event in enumerate(events):
        meta["events"].append(
            {
                "kind": event.kind, "parameter": event.parameter, "uncertainty": event.uncertainty,
                "arclength": event.arclength, "row": event.row, "after_row": event.after_row,
                "index_before": event.index_before, "index_after": event.index_after,
                "equilibrium_parameter": event.equilibrium_parameter,
                "energy_released": event.energy_released, "detail": event.detail,
                "dp": event.direction[2],
            }
        )  # fmt: skip
        arrays[f"event.{i}.modes"] = event.modes
        arrays[f"event.{i}.dx"], arrays[f"event.{i}.dm"] = event.direction[:2]
    return meta, arrays


def unpack(
    meta: Mapping[str, Any], arrays: dict[str, Any], family: Family, path: Any
) -> tuple[tuple[Row, ...], tuple[Event, ...], Settings, bool]:
    """Return the rows and events of a file, its settings, and whether the branch is finished."""
    kinds = needed(meta, "rows", path)
    settings = settings_from(meta, path)
    count = len(kinds)
    try:
        parameters = arrays["parameter"]
        structures = [family(float(p)) for p in parameters]
        equilibria = unpack_equilibria(arrays, structures, path)
        rows = tuple(
            Row(
                kinds[i], float(parameters[i]), float(arrays["arclength"][i]),
                float(arrays["smallest_eigenvalue"][i]), int(arrays["index"][i]),
                bool(arrays["marginal"][i]),
                dict(zip(settings.outputs, map(float, arrays["outputs"][i]), strict=True)),
                equilibria[i],
            )
            for i in range(count)
        )  # fmt: skip
        events = []
        for i, item in enumerate(needed(meta, "events", path)):
            item = dict(item)
            direction = (
                arrays[f"event.{i}.dx"], arrays[f"event.{i}.dm"], float(item.pop("dp")),
            )  # fmt: skip
            after = item["after_row"]
            events.append(
                Event(
                    **item, equilibrium=rows[item["row"]].equilibrium,
                    after=None if after < 0 else rows[after].equilibrium,
                    modes=arrays[f"event.{i}.modes"], direction=direction,
                )
            )  # fmt: skip
    except (KeyError, IndexError, TypeError) as error:
        raise DataError(f"the file {path} is incomplete: {error!r} is missing or wrong") from error
    if not fits(equilibria[-1]):
        raise not_of_family(path, float(parameters[-1]))
    return rows, tuple(events), settings, bool(needed(meta, "finished", path))
