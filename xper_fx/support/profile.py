# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profile of a run: where its time goes, phase by phase, and what each phase holds in memory.

Phases nest as the code enters them, so that the profile is a tree, step > newton > interaction
solve; kernels that Numba compiles meanwhile are the phase "compiling" within. What no phase covers
is the row "other", which is shown like any: the rows' own times sum to the wall time of the run.
Entering and leaving a phase costs less than a microsecond.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from time import perf_counter
from typing import NamedTuple, TypeVar
from weakref import finalize, ref

from numba.core import event

from xper_fx.cache.compiling import KIND, CompilationListener

Item = TypeVar("Item")

OTHER = "other"


class Phase:
    """A phase under those that were open when it was entered; the context in which it is timed.

    Attributes:
        name: what is done.
        seconds: spent in it, phases within included.
        calls: how often it was left, by an exception too.
        parts: phases within, by name, in the order they were first entered.
    """

    __slots__ = ("_parent", "_start", "_watch", "calls", "name", "parts", "seconds")

    def __init__(self, name: str, watch: Stopwatch, parent: Phase | None = None):
        self.name, self.seconds, self.calls = name, 0.0, 0
        self.parts: dict[str, Phase] = {}
        self._watch, self._parent, self._start = watch, parent, 0.0

    def __enter__(self) -> Phase:
        self._watch.current = self
        self._start = perf_counter()
        return self

    def __exit__(self, *exception: object) -> None:
        self.seconds += perf_counter() - self._start
        self.calls += 1
        self._watch.current = self._parent


class PhaseRow(NamedTuple):
    """A line of the profile."""

    path: tuple[str, ...]  #: the phase's name after those of the phases around it
    seconds: float  #: time spent, phases within included (s)
    own: float  #: of which in no phase within (s)
    share: float  #: of the wall time of the run
    calls: int  #: how often the phase was entered; 0 for "other"
    bytes: int  #: held by the arrays that the phase owns, or written to disk by it; 0 if none


class _Compilations(CompilationListener):
    """Enters the phase "compiling" of a stopwatch while Numba compiles, if a phase is open."""

    def __init__(self, watch: Stopwatch):
        super().__init__()
        self._watch, self._phase = ref(watch), None

    def begin(self) -> None:
        watch = self._watch()
        if watch.running:
            self._phase = watch.phase("compiling")
            self._phase.__enter__()

    def end(self) -> None:
        if self._phase is not None:
            self._phase.__exit__()
            self._phase = None


class Stopwatch:
    """Times the phases of a run, counts them, and knows what they hold.

    Attributes:
        current: innermost phase that is open.
    """

    def __init__(self) -> None:
        self._owned: dict[str, Callable[[], int]] = {}
        self.restart()
        compilations = _Compilations(self)
        event.register(KIND, compilations)
        finalize(self, event.unregister, KIND, compilations)

    def restart(self) -> None:
        """Forget the times and calls so far; not while a phase is open."""
        self.current = self._root = Phase("run", self)
        self._began = perf_counter()

    def phase(self, name: str) -> Phase:
        """The phase of a name within the open one: `with stopwatch.phase("step"): ...`."""
        current = self.current
        try:
            return current.parts[name]
        except KeyError:
            part = current.parts[name] = Phase(name, self, current)
            return part

    def each(self, name: str, items: Iterable[Item]) -> Iterator[Item]:
        """The items of a loop, whose passes are the calls of a phase; `break` leaves it."""
        for item in items:
            with self.phase(name):
                yield item

    def owns(self, name: str, count: Callable[[], int]) -> None:
        """Say how many bytes the arrays (or files) of a phase take, wherever it is in the tree."""
        self._owned[name] = count

    @property
    def running(self) -> bool:
        """Whether a phase is open."""
        return self.current is not self._root

    @property
    def wall(self) -> float:
        """Seconds since the start."""
        return perf_counter() - self._began

    @property
    def seconds(self) -> dict[str, float]:
        """Total seconds by phase, wherever it is in the tree."""
        totals: dict[str, float] = {}
        for path, phase in self._walk(self._root, ()):
            if phase.name not in path[:-1]:
                totals[phase.name] = totals.get(phase.name, 0.0) + phase.seconds
        return totals

    @property
    def calls(self) -> dict[str, int]:
        """Total calls by phase, wherever it is in the tree."""
        totals: dict[str, int] = {}
        for _, phase in self._walk(self._root, ()):
            totals[phase.name] = totals.get(phase.name, 0) + phase.calls
        return totals

    def _walk(self, phase: Phase, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Phase]]:
        for part in phase.parts.values():
            inner = (*path, part.name)
            yield inner, part
            yield from self._walk(part, inner)

    def rows(self) -> list[PhaseRow]:
        """The profile so far, a phase before those within it, "other" last.

        A phase that is open counts up to its last exit. Bytes stand at the first place of a name.
        """
        wall, left = self.wall, dict(self._owned)
        rows = []
        for path, phase in self._walk(self._root, ()):
            own = phase.seconds - sum(part.seconds for part in phase.parts.values())
            count = left.pop(phase.name, None)
            rows.append(
                PhaseRow(
                    path,
                    phase.seconds,
                    own,
                    phase.seconds / wall,
                    phase.calls,
                    count() if count else 0,
                )
            )
        other = wall - sum(part.seconds for part in self._root.parts.values())
        return [*rows, PhaseRow((OTHER,), other, other, other / wall, 0, 0)]


def profile_table(rows: Sequence[PhaseRow]) -> str:
    """The rows of a stopwatch as text; indents show what is within what."""
    lines = [
        f"{'phase':<30}{'time':>11}{'own time':>11}{'share':>9}{'calls':>9}{'a call':>14}"
        f"{'bytes':>12}"
    ]
    for row in rows:
        name = "  " * (len(row.path) - 1) + row.path[-1]
        mean = f"{1e3 * row.seconds / row.calls:.3f} ms" if row.calls else "-"
        held = f"{row.bytes / 1e6:.2f} MB" if row.bytes else "-"
        lines.append(
            f"{name:<30}{row.seconds:>9.3f} s{row.own:>9.3f} s{100.0 * row.share:>7.1f} %"
            f"{row.calls or '-':>9}{mean:>14}{held:>12}"
        )
    return "\n".join(lines)
