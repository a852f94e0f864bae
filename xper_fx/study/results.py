# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of a study: errors, Pareto front, what tightening a parameter buys, tables and files."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import floor, log10
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import spearmanr

from xper_fx.output.summary import write_summary
from xper_fx.study.definition import Setting, Study, as_text, value_text, varied
from xper_fx.support.checks import require_non_negative, require_path

COSTS = {
    "seconds": ("wall time", "s", 1.0),
    "cpu_seconds": ("processor time", "s", 1.0),
    "peak_memory": ("peak memory", "MB", 1e6),
    "array_bytes": ("memory of arrays", "MB", 1e6),
}
"""What a run costs: entry of its record, and its name, unit and the unit's value in figures."""

TIMES = ("seconds", "cpu_seconds")
"""What counts as time."""

# Errors that differ by less than this share count as the same when a parameter is tightened.
_GAIN = 0.15


def pareto_front(cost: npt.ArrayLike, error: npt.ArrayLike) -> npt.NDArray[np.intp]:
    """The runs that no other beats in both cost and error.

    Args:
        cost, error: shape (n,); a run with a NaN is left out.

    Returns:
        Their numbers, from cheap to dear, so that errors fall. Of equal runs, the first.
    """
    cost, error = np.asarray(cost, float), np.asarray(error, float)
    front, best = [], np.inf
    for i in np.lexsort((error, cost)):
        if np.isfinite(cost[i]) and error[i] < best:
            front.append(i)
            best = error[i]
    return np.array(front, np.intp)


@dataclass(frozen=True)
class Run:
    """One run of a study.

    Attributes:
        setting: its parameters.
        families: those it belongs to; none for a reference.
        record: what was measured: `status` ("done" or "failed" with `reason`), `seconds` of
            stepping, `cpu_seconds`, `set_up_seconds`, `peak_memory` and `array_bytes` (bytes),
            `step_size` (s), `steps`, `sweeps`, `newton_iterations`, `closure` (over the largest
            energy), `estimated_error` or None.
        values: of the quantities.
        errors: of the quantities, filled in by `StudyResults`.
    """

    setting: Setting
    families: tuple[str, ...]
    record: Mapping[str, Any]
    values: Mapping[str, Any]
    errors: dict[str, float] = field(default_factory=dict)

    @classmethod
    def read(cls, setting: Setting, families: tuple[str, ...], path: Path) -> Run:
        """Read what `study_process.run_job` wrote at a path without suffix."""
        record = json.loads(path.with_suffix(".json").read_text())
        values = dict(record.pop("values", {}))
        if path.with_suffix(".npz").exists() and record["status"] == "done":
            with np.load(path.with_suffix(".npz")) as arrays:
                for name in arrays.files:
                    quantity, part = name.rsplit(": ", 1)
                    values.setdefault(quantity, {})[part] = arrays[name]
        return cls(setting, families, record, values)

    @property
    def done(self) -> bool:
        """Whether it came to its end."""
        return self.record["status"] == "done"

    def cost(self, name: str) -> float:
        """One of `COSTS` (s or bytes); NaN if it failed."""
        return self.record[name] if self.done else np.nan


class Saturation(NamedTuple):
    """From which value on tightening a parameter no longer lowers an error."""

    parameter: str  #: which
    others: Setting  #: the other parameters of these runs
    value: Any  #: from which on, None if every tightening still pays
    error: float  #: there
    tightest: Any  #: the tightest value tried
    error_at_tightest: float  #: there


class StudyResults:
    """Runs of a study with their errors.

    Args:
        study: what was run.
        runs: one for each of `study.settings()`.
        time: "seconds" of the wall, or "cpu_seconds" of the processor, which other work on the
            machine disturbs less: what table, front and advice take as time.

    Raises:
        RuntimeError: the reference's run failed.
        ValueError: a time that does not exist.
    """

    def __init__(self, study: Study, runs: Sequence[Run], time: str = "seconds"):
        if time not in TIMES:
            raise ValueError(f"time should be one of {', '.join(TIMES)}, got {time!r}.")
        self.study, self.runs, self.time = study, list(runs), time
        self.reference = self._run_of(study.reference)
        if self.reference is not None and not self.reference.done:
            raise RuntimeError(
                f"The reference {as_text(study.reference)} failed, so that nothing can be compared "
                f"with it: {self.reference.record['reason']}. Take another reference."
            )
        for run in self.runs:
            for name, quantity in study.quantities.items():
                if run.done:
                    run.errors[name] = float(quantity.error(run.values[name], self._exact(name)))

    def _exact(self, quantity: str) -> Any:
        if not self.study.quantities[quantity].has_reference:
            return None
        if quantity in self.study.known:
            return self.study.known[quantity]
        return self.reference.values[quantity]

    def _is_compared(self, quantity: str) -> bool:
        """Whether the reference is a run, rather than known or not needed."""
        needed = self.study.quantities[quantity].has_reference
        return needed and quantity not in self.study.known

    def _run_of(self, setting: Setting | None) -> Run | None:
        return next((run for run in self.runs if run.setting == setting), None)

    @property
    def default(self) -> Run | None:
        """The run with the study's default setting."""
        return self._run_of(self.study.default)

    @cached_property
    def varied(self) -> list[str]:
        """Parameters that are not the same in all families' settings, in order of appearance."""
        return varied([run.setting for run in self.runs if run.families])

    def label(self, run: Run) -> str:
        """A run by the parameters that vary."""
        parameters = self.varied if run.families else varied([other.setting for other in self.runs])
        return as_text(run.setting, parameters) or as_text(run.setting)

    def members(self, family: str) -> list[Run]:
        """Runs of a family, in its order.

        Raises:
            ValueError: no such family.
        """
        _require_known("family", family, self.study.families)
        return [self._run_of(setting) for setting in self.study.families[family]]

    def candidates(self, quantity: str) -> list[Run]:
        """Runs to choose from: done, in a family, and not the reference for this quantity.

        Raises:
            ValueError: no such quantity.
        """
        _require_known("quantity", quantity, self.study.quantities)
        left_out = self.reference if self._is_compared(quantity) else None
        return [run for run in self.runs if run.done and run.families and run is not left_out]

    def trust(self, quantity: str) -> float:
        """How far the check is from the reference: below, errors say nothing; 0 without one.

        Raises:
            ValueError: no such quantity.
        """
        _require_known("quantity", quantity, self.study.quantities)
        run = self._run_of(self.study.check)
        if run is None or not self._is_compared(quantity):
            return 0.0
        return run.errors.get(quantity, 0.0)

    def front(self, quantity: str, cost: str | None = None) -> list[Run]:
        """The Pareto front in one of `COSTS` (the time if None), from cheap to dear.

        Errors below what the reference is good for count as equal.

        Raises:
            ValueError: no such quantity or cost.
        """
        _require_known("cost", cost or self.time, COSTS)
        runs, cost, trust = self.candidates(quantity), cost or self.time, self.trust(quantity)
        errors = [max(r.errors[quantity], trust) for r in runs]
        chosen = pareto_front([r.cost(cost) for r in runs], errors)
        return [runs[i] for i in chosen]

    def rate(self, quantity: str, family: str, parameter: str) -> float:
        """Exponent p of error ~ parameter^p, least squares over a family's runs; NaN below two.

        Raises:
            ValueError: no such quantity, family or parameter.
        """
        _require_known("quantity", quantity, self.study.quantities)
        self._require_parameter(parameter)
        runs = [r for r in self.members(family) if r.done and r.errors[quantity] > 0.0]
        if len({r.setting[parameter] for r in runs}) < 2:
            return np.nan
        x = np.log([r.setting[parameter] for r in runs])
        return float(np.polyfit(x, np.log([r.errors[quantity] for r in runs]), 1)[0])

    def _require_parameter(self, parameter: str) -> None:
        known = dict.fromkeys(name for run in self.runs for name in run.setting)
        _require_known("parameter", parameter, known)

    # Advice

    def cheapest(self, quantity: str, error: float) -> Run | None:
        """The fastest run with an error of at most `error`.

        Raises:
            TypeError, ValueError: no such quantity, an error that is no number, zero or above.
        """
        require_non_negative("error", error)
        runs = [r for r in self.candidates(quantity) if r.errors[quantity] <= error]
        return min(runs, key=lambda r: r.record[self.time], default=None)

    def saturation(self, quantity: str, parameter: str) -> list[Saturation]:
        """From which value of a parameter on tightening buys nothing, others equal.

        Tight is where the reference's value is; without a reference, where time is. One entry for
        each group of three runs or more that differ in the parameter alone.

        Raises:
            ValueError: no such quantity or parameter.
        """
        self._require_parameter(parameter)
        groups: dict[str, list[Run]] = {}
        for run in self.candidates(quantity):
            value = run.setting.get(parameter)
            if isinstance(value, int | float) and not isinstance(value, bool):
                others = {k: v for k, v in run.setting.items() if k != parameter}
                groups.setdefault(as_text(dict(sorted(others.items()))), []).append(run)
        return [self._saturation(quantity, parameter, g) for g in groups.values() if len(g) >= 3]

    def _saturation(self, quantity: str, parameter: str, runs: list[Run]) -> Saturation:
        runs = sorted(runs, key=lambda r: r.setting[parameter])
        values = [r.setting[parameter] for r in runs]
        finest = None if self.reference is None else self.reference.setting.get(parameter)
        if finest is not None and not values[0] < finest < values[-1]:
            falling = finest <= values[0]
        else:
            falling = spearmanr(values, [r.record[self.time] for r in runs]).statistic < 0
        if falling:
            runs = runs[::-1]
        # differences below what the reference is good for are none
        errors = np.maximum([r.errors[quantity] for r in runs], self.trust(quantity))
        last = runs[-1]
        others = {k: v for k, v in last.setting.items() if k != parameter}
        for i in range(len(runs) - 1):
            if errors[i + 1 :].min() >= (1.0 - _GAIN) * errors[i]:
                value, error = runs[i].setting[parameter], float(errors[i])
                break
        else:
            value, error = None, float(errors[-1])
        return Saturation(
            parameter, others, value, error, last.setting[parameter], float(errors[-1])
        )

    def advice(self, quantity: str, targets: Sequence[float] = (0.1, 0.01, 1e-3, 1e-4)) -> str:
        """What to take for which error, from the runs made, and which parameters buy nothing.

        Args:
            quantity: the error of which.
            targets: errors asked for, from large to small.

        Raises:
            TypeError, ValueError: no such quantity, targets that are no errors.
        """
        for target in targets:
            require_non_negative("A target", target)
        trust, parts, chosen = self.trust(quantity), [], {}
        below = [t for t in targets if t < trust]
        for target in targets:
            if target in below:
                continue
            run = self.cheapest(quantity, target)
            chosen.setdefault(None if run is None else id(run), (run, []))[1].append(target)
        for run, reached in chosen.values():
            if run is None:
                parts.append(f"no run reached {percent(max(reached))}")
                continue
            # what does for the tightest does for the others too
            parts.append(
                f"for {percent(min(reached))} take {self.label(run)} "
                f"({run.record[self.time]:.2g} s, error {percent(run.errors[quantity])})"
            )
        if below:
            parts.append(
                f"{percent(max(below))} cannot be told, as the reference itself is good to "
                f"{percent(trust)} only"
            )
        if self.default is not None and self.default.done:
            parts.append(
                f"the default has {percent(self.default.errors[quantity])} in "
                f"{self.default.record[self.time]:.2g} s"
            )
        for parameter in self.varied:
            parts += [
                f"{parameter} tighter than {value_text(s.value)} buys nothing "
                f"({percent(s.error)} there, {percent(s.error_at_tightest)} at "
                f"{value_text(s.tightest)}; {as_text(s.others, self.varied) or 'others alike'})"
                for s in self.saturation(quantity, parameter)
                if s.value is not None
            ]
        return f"{quantity}: " + "; ".join(parts) + "."

    # Tables and files

    def _rows(self) -> list[dict[str, Any]]:
        """One mapping a run: all parameters, what was measured, errors."""
        rows = []
        for run in self.runs:
            record = {k: v for k, v in run.record.items() if k not in ("setting", "study")}
            values = {f"value {k}": v for k, v in run.values.items() if np.isscalar(v)}
            errors = {f"error {k}": v for k, v in run.errors.items()}
            families = {"families": "; ".join(run.families)}
            rows.append(families | dict(run.setting) | record | values | errors)
        return rows

    def to_csv(self, path: str | Path) -> None:
        """Write one line a run: parameters, what was measured, values and errors.

        Raises:
            TypeError: no path.
        """
        path = require_path("path", path)
        rows = self._rows()
        columns = list(dict.fromkeys(column for row in rows for column in row))
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, columns, restval="")
            writer.writeheader()
            writer.writerows(rows)

    def to_json(self, path: str | Path) -> None:
        """Write runs, front and advice.

        Raises:
            TypeError: no path.
        """
        path = require_path("path", path)
        quantities = list(self.study.quantities)
        write_summary(
            path,
            {
                "study": self.study.name,
                "runs": self._rows(),
                "front": {q: [self.label(r) for r in self.front(q)] for q in quantities},
                "advice": {q: self.advice(q) for q in quantities},
            },
        )

    def table(self) -> str:
        """All runs as a Markdown table, from fast to slow; * marks the front of a quantity."""
        quantities = list(self.study.quantities)
        fronts = {q: {id(run) for run in self.front(q)} for q in quantities}
        heads = ["run", "s", "MB", "steps", "sweeps", "Newton", "closure", *quantities, ""]
        lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
        for run in sorted(self.runs, key=lambda r: r.record.get(self.time, np.inf)):
            notes = [n for n in ("default", "reference", "check") if self._is(run, n)]
            cells = [self.label(run)]
            if run.done:
                r = run.record
                cells += [
                    f"{r[self.time]:.3g}",
                    f"{r['peak_memory'] / 1e6:.0f}",
                    str(r["steps"]),
                    str(r["sweeps"]),
                    str(r["newton_iterations"]),
                    f"{r['closure']:.0e}",
                ]
                cells += [
                    f"{run.errors[q]:.1e}{'*' if id(run) in fronts[q] else ''}" for q in quantities
                ]
                if r.get("estimated_error") is not None:
                    notes.append(f"estimate {r['estimated_error']:.1e}")
            else:
                cells += ["-"] * (len(heads) - 2)
                notes.append(f"failed: {run.record['reason']}")
            lines.append("| " + " | ".join([*cells, ", ".join(notes)]) + " |")
        return "\n".join(lines)

    def _is(self, run: Run, which: str) -> bool:
        return run.setting == getattr(self.study, which)


def _require_known(what: str, name: Any, known: Iterable[str]) -> None:
    if name not in (known := list(known)):
        raise ValueError(f"There is no {what} {name!r}; there are {', '.join(map(str, known))}.")


def percent(error: float) -> str:
    """An error as text in percent, two figures."""
    share = 100.0 * error
    if share == 0.0:
        return "0 %"
    if share < 1e-3:
        return f"{share:.0e} %"
    text = f"{share:.{max(1 - floor(log10(share)), 0)}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"
