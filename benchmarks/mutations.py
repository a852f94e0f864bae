# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mutation testing: lines of the package are broken one by one, and tests have to see it.

    ./fenicsx python3 benchmarks/mutations.py [--only PATTERN] [--out FOLDER]

`mutations.toml` lists what is broken and by which tests it should be seen. All of it happens in a
copy in a temporary folder; the checkout is not touched. Tests first have to pass on good code. For
each mutation a line is printed:

- caught: a test failed, or the run took longer than the time limit;
- survived: all tests passed, though the code is wrong. Either a test is missing, or the entry says
  in `explained` why nothing can see it;
- does not apply: the line is no longer there, or occurs more than once; the list has to be mended;
- no test: the tests named fail on good code, or there are none of that name.

The score is the share of caught ones among those that were caught or survived. The exit status is 0
where every survivor is explained and every entry applies. With `--out` the results are written to
`mutations.csv`.

Kernels are kept as ever (`XPER_FX_CACHE`): only what a mutation touches is compiled again, and what
was compiled of broken code gives way in time.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_suffix(".toml")
# What tests need of the checkout.
COPIED = ("xper_fx", "tests", "benchmarks", "demos", "pyproject.toml")
# Time limit of the tests of one mutation (s); good code takes a few seconds.
LIMIT = 300.0
# Exit statuses of pytest: all passed; one failed; modules that cannot be imported.
PASSED, FAILED, BROKEN = 0, 1, 2

CAUGHT, SURVIVED, DOES_NOT_APPLY, NO_TEST = "caught", "survived", "does not apply", "no test"


class DoesNotApplyError(ValueError):
    """A mutation whose line is not there, or is there more than once."""


@dataclass(frozen=True)
class Mutation:
    """One way to break the package.

    Attributes:
        file: below `xper_fx`.
        line: what is broken, a fragment of the file that occurs once.
        becomes: what takes its place.
        tests: arguments of pytest that name the tests.
        breaks: what is wrong then, in words.
        inside: start of the line of a function or class within which `line` occurs once; empty for
            the whole file.
        explained: why no test can see it; empty where one should.
    """

    file: str
    line: str
    becomes: str
    tests: str
    breaks: str
    inside: str = ""
    explained: str = ""

    def broken(self, text: str) -> str:
        """The text of the file with the mutation.

        Raises:
            DoesNotApplyError: the line does not occur exactly once.
        """
        start, end = block(text, self.inside) if self.inside else (0, len(text))
        count = text.count(self.line, start, end)
        if count != 1:
            raise DoesNotApplyError(f"{self.line!r} occurs {count} times in {self.file}")
        at = text.index(self.line, start, end)
        return text[:at] + self.becomes + text[at + len(self.line) :]


def block(text: str, name: str) -> tuple[int, int]:
    """Where the function or class whose line starts with `name` begins and ends in a text.

    Raises:
        DoesNotApplyError: no line or several lines start so.
    """
    heads = list(re.finditer(rf"^( *){re.escape(name)}", text, re.MULTILINE))
    if len(heads) != 1:
        raise DoesNotApplyError(f"{len(heads)} lines start with {name!r}")
    start, indent = heads[0].start(), len(heads[0][1])
    # the first line that is indented no more, brackets of a signature left out
    end = re.compile(rf"^ {{0,{indent}}}[^\s)\]}}]", re.MULTILINE).search(text, heads[0].end())
    return start, end.start() if end else len(text)


def listed() -> list[Mutation]:
    """All mutations of the list."""
    with open(LIST, "rb") as file:
        return [Mutation(**entry) for entry in tomllib.load(file)["mutation"]]


class Workshop:
    """A copy of the package in which lines are broken.

    Args:
        folder: where it is made.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        for name in COPIED:
            source = CHECKOUT / name
            if source.is_dir():
                shutil.copytree(
                    source, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.png")
                )
            else:
                shutil.copy2(source, folder)
        self._passes: dict[str, bool] = {}

    def try_out(self, mutation: Mutation) -> str:
        """What the tests say of a mutation; the code is whole again afterwards."""
        path = self.folder / "xper_fx" / mutation.file
        if not path.exists():
            return DOES_NOT_APPLY
        text = path.read_text()
        try:
            broken = mutation.broken(text)
        except DoesNotApplyError:
            return DOES_NOT_APPLY
        if not self._pass_on_good_code(mutation.tests):
            return NO_TEST
        try:
            self._write(path, broken)
            status = self._run(mutation.tests)
        finally:
            self._write(path, text)
        return {PASSED: SURVIVED, FAILED: CAUGHT, BROKEN: CAUGHT}.get(status, NO_TEST)

    def _pass_on_good_code(self, tests: str) -> bool:
        if tests not in self._passes:
            self._passes[tests] = self._run(tests) == PASSED
        return self._passes[tests]

    @staticmethod
    def _write(path: Path, text: str) -> None:
        """Write a module; byte code is told apart by times of a second, and goes."""
        path.write_text(text)
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
            compiled.unlink()

    def _run(self, tests: str) -> int:
        """Status of pytest; that of a failure if it takes too long."""
        paths = [str(self.folder), os.environ.get("PYTHONPATH", "")]
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider",
             "-p", "no:xdist", *shlex.split(tests)],
            cwd=self.folder, env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            return process.wait(LIMIT)
        except subprocess.TimeoutExpired:
            return FAILED
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def write_csv(results: list[tuple[Mutation, str, float]], folder: Path) -> None:
    """Write the results to `mutations.csv` in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "mutations.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("verdict", "file", "breaks", "line", "becomes", "tests", "explained", "s"))
        for m, verdict, seconds in results:
            table.writerow(
                (verdict, m.file, m.breaks, m.line, m.becomes, m.tests, m.explained,
                 f"{seconds:.1f}")
            )  # fmt: skip


def main() -> int:
    """Run the mutations asked for; 0 if all is as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="those whose file or words match this pattern")
    parser.add_argument("--out", type=Path, help="folder for mutations.csv")
    arguments = parser.parse_args()
    chosen = [m for m in listed() if re.search(arguments.only, f"{m.file}: {m.breaks}")]
    results = []
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        workshop = Workshop(Path(folder))
        for number, mutation in enumerate(chosen, start=1):
            start = time.perf_counter()
            verdict = workshop.try_out(mutation)
            seconds = time.perf_counter() - start
            results.append((mutation, verdict, seconds))
            what = f"{mutation.file}: {mutation.breaks}"
            if verdict == SURVIVED and mutation.explained:
                what += f" (explained: {mutation.explained})"
            print(f"{number:3d}/{len(chosen)} {verdict:14s} {seconds:5.1f} s  {what}", flush=True)
            if arguments.out is not None:
                write_csv(results, arguments.out)
    count = Counter(verdict for _, verdict, _ in results)
    told = count[CAUGHT] + count[SURVIVED]
    if told:
        print(f"score: {count[CAUGHT]} of {told} caught, {100.0 * count[CAUGHT] / told:.1f} %")
    for verdict in (DOES_NOT_APPLY, NO_TEST):
        if count[verdict]:
            print(f"{verdict}: {count[verdict]}, to be mended in {LIST.name}")
    wrong = [m for m, verdict, _ in results if verdict != CAUGHT and not m.explained]
    return 1 if wrong or not results else 0


if __name__ == "__main__":
    sys.exit(main())
