# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a study runs and compares; `study.py` runs it."""

from __future__ import annotations

import hashlib
import inspect
import itertools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any

from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.process import Job
from xper_fx.study.quantities import Quantity
from xper_fx.support.checks import require_count, require_kind, require_positive
from xper_fx.support.version import __version__

Parameter = str | int | float | bool | None
Setting = dict[str, Parameter]
AnySetting = Mapping[str, Parameter]
"""A setting as functions take it."""

# Parameters of the study itself.
_OWN = ("courant", "fields")


def vary(default: AnySetting, parameter: str, values: Iterable[Parameter]) -> list[Setting]:
    """A family of settings: one parameter varied, the others as they are.

    Raises:
        TypeError: values that are no list, a default that is no mapping.
    """
    require_kind("default", default, Mapping)
    _require_values("values", values)
    return [{**default, parameter: value} for value in values]


def product(default: AnySetting, **values: Iterable[Parameter]) -> list[Setting]:
    """A family of settings: all combinations of some parameters' values, the others as they are.

    Raises:
        TypeError: values that are no list, a default that is no mapping.
    """
    require_kind("default", default, Mapping)
    for name, chosen in values.items():
        _require_values(name, chosen)
    return [
        {**default, **dict(zip(values, chosen, strict=True))}
        for chosen in itertools.product(*values.values())
    ]


def _require_values(name: str, values: Any) -> None:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise TypeError(f"{name} should be a list of values, got {values!r}.")


def as_text(setting: AnySetting, parameters: Sequence[str] | None = None) -> str:
    """A setting as text, "scheme=explicit, courant=0.7"; only some parameters if they are named."""
    chosen = setting if parameters is None else [k for k in parameters if k in setting]
    return ", ".join(f"{parameter}={value_text(setting[parameter])}" for parameter in chosen)


def varied(settings: Sequence[Setting]) -> list[str]:
    """Parameters that are not the same in all settings, in order of appearance."""
    parameters = dict.fromkeys(parameter for setting in settings for parameter in setting)
    return [k for k in parameters if len({as_text(s, [k]) for s in settings}) > 1]


def value_text(value: Any) -> str:
    """A parameter's value as text, numbers in short."""
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Study:
    """What to run and what to compare.

    A setting is a mapping of parameters to values. Parameters are those of `build`, of `Simulation`
    (one that both have goes to both), and two of the study's own: `courant`, the step over the
    critical step of the scene's explicit bulk, and `fields`, the number of times at which fields
    are written during the run.

    Args:
        name: of the study.
        build: function at the top level of a module or script, which makes the scene.
        end_time: of each run (s). Steps are shortened so that a whole number of them ends there.
        quantities: what is compared, by name (`quantities.py`).
        families: settings by the name of their family, each in the order in which it is drawn. A
            setting may be in several; it is run once.
        reference: the setting whose values count as exact; not needed if all values are known.
        known: exact values by name of quantity; they go before the reference's.
        check: another setting as fine as the reference; how far it is from it is how far the
            reference is to be trusted.
        default: the setting that is marked in figures.

    Raises:
        TypeError: a parameter's value is no number, text, bool or None, `build` cannot be
            imported, or something is of another kind than is expected.
        ValueError: a parameter that neither `build` nor `Simulation` has, one that `build` lacks,
            no setting, no reference.
    """

    name: str
    build: Callable[..., Scene]
    end_time: float
    quantities: Mapping[str, Quantity]
    families: Mapping[str, Sequence[AnySetting]]
    reference: AnySetting | None = None
    known: Mapping[str, Any] = field(default_factory=dict)
    check: AnySetting | None = None
    default: AnySetting | None = None

    def __post_init__(self) -> None:
        require_positive("end_time", self.end_time)
        if not isinstance(self.name, str) or not self.name:
            raise TypeError(f"name should be a text, got {self.name!r}.")
        for name in ("quantities", "families", "known"):
            require_kind(name, getattr(self, name), Mapping)
        for name, quantity in self.quantities.items():
            methods = ("observe", "value", "error", "has_reference")
            whole = all(hasattr(quantity, method) for method in methods)
            if isinstance(quantity, type) or not whole or not isinstance(name, str):
                raise TypeError(
                    f"quantities should be objects of xf.quantities by name, got {quantity!r} for "
                    f"{name!r}."
                )
        for name, family in self.families.items():
            if not isinstance(family, Sequence) or not all(isinstance(s, Mapping) for s in family):
                raise TypeError(
                    f"families should be lists of settings by name, got {family!r} for {name!r}."
                )
        for name in ("reference", "check", "default"):
            if getattr(self, name) is not None:
                require_kind(name, getattr(self, name), Mapping)
        for name, value in self.known.items():
            if isinstance(value, float) and not isfinite(value):
                raise ValueError(f"known should be finite, got {value} for {name!r}.")
        if "<" in getattr(self.build, "__qualname__", "<"):
            raise TypeError(
                f"build is {self.build!r}; it should be a function at the top level of a module or "
                "script, which another process can import."
            )
        if not self.quantities or not all(self.families.values()) or not self.families:
            raise ValueError("A study needs at least one quantity and one setting in each family.")
        unknown = sorted(set(self.known) - set(self.quantities))
        if unknown:
            raise ValueError(
                f"known names {unknown}, which are no quantities; these are: "
                f"{sorted(self.quantities)}."
            )
        lacking = [
            name
            for name, q in self.quantities.items()
            if q.has_reference and name not in self.known
        ]
        if lacking and self.reference is None:
            raise ValueError(
                f"The quantities {lacking} have no reference: give the finest setting as "
                "`reference`, or their exact values in `known`."
            )
        for setting in self.settings():
            self._check(setting)
        for name, quantity in self.quantities.items():
            if " at 0x" in repr(quantity):
                raise TypeError(
                    f"The quantity {name!r} prints as {quantity!r}, which changes from run to run, "
                    "so that results could not be found again; give it a dataclass's repr."
                )

    def settings(self) -> list[Setting]:
        """All settings to run, each once: those of families, default, reference and check."""
        named = (self.default, self.reference, self.check)
        chained = [*itertools.chain(*self.families.values()), *(s for s in named if s is not None)]
        return list({as_text(setting): setting for setting in chained}.values())

    def _parameters_of(self, function: Callable) -> list[str]:
        parameters = inspect.signature(function).parameters.values()
        return [p.name for p in parameters if p.name not in ("self", "scene")]

    def _check(self, setting: Setting) -> None:
        """Raise unless `build` and `Simulation` can take a setting."""
        of_build, of_run = self._parameters_of(self.build), self._parameters_of(Simulation.__init__)
        for parameter, value in setting.items():
            if not isinstance(value, Parameter):
                raise TypeError(
                    f"Parameter {parameter!r} has the value {value!r}; it should be a number, a "
                    "text, a bool or None, which can be written into a file and compared."
                )
            if isinstance(value, float) and not isfinite(value):
                raise ValueError(f"Parameter {parameter!r} is {value}; it should be finite.")
            known = [*of_build, *of_run, *_OWN]
            if parameter not in known:
                near = get_close_matches(parameter, known, 1)
                raise ValueError(
                    f"Parameter {parameter!r} is neither one of {self.build.__name__} "
                    f"({', '.join(of_build)}) nor of Simulation ({', '.join(of_run)}) nor of a "
                    f"study ({', '.join(_OWN)}){f'; {near[0]!r}?' if near else '.'}"
                )
        if setting.get("courant") is not None:
            require_positive("courant", setting["courant"])
        if setting.get("fields") is not None:
            require_count("fields", setting["fields"], 0)
        if setting.get("courant") is not None and setting.get("step") is not None:
            raise ValueError(f"A setting gives both courant and step, give one: {setting}.")
        try:
            inspect.signature(self.build).bind(**self.split(setting)[0])
        except TypeError as error:
            raise ValueError(
                f"{self.build.__name__} cannot be called with {setting}: {error}."
            ) from None

    def split(self, setting: Setting) -> tuple[Setting, Setting]:
        """Parameters of `build` and parameters of `Simulation`."""
        of_build, of_run = self._parameters_of(self.build), self._parameters_of(Simulation.__init__)
        return (
            {k: v for k, v in setting.items() if k in of_build},
            {k: v for k, v in setting.items() if k in of_run},
        )

    def job(self, setting: Setting) -> Job:
        """What one process does."""
        scene, simulation = self.split(setting)
        return Job(
            self.build,
            scene,
            simulation,
            setting.get("courant"),
            setting.get("fields") or 0,
            self.end_time,
            dict(self.quantities),
        )

    def key(self, setting: Setting) -> str:
        """Names a run by all that decides its result: settings, `build` and its source, quantities,
        end time and the package's version. What `build` calls is not looked into: empty the folder
        after changing that."""
        parts = {
            "setting": setting,
            "build": f"{Path(inspect.getfile(self.build)).stem}.{self.build.__qualname__}",
            "source": inspect.getsource(self.build),
            "quantities": {name: repr(q) for name, q in self.quantities.items()},
            "end_time": self.end_time,
            "version": __version__,
        }
        text = json.dumps(parts, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
