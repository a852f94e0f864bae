# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hundreds of misuses of the public interface, and what a script hears of each.

Each should be a clear error before any work, or one warning where the input may be meant
(`tests/shared/misuse.py`). Groups of misuses run in processes of their own, so that a crash, or
what takes longer than ten seconds, is seen and the rest goes on. The exit status is 1 if anything
was obscure, silent or hung. A name on the command line runs the groups or misuses that contain it.

    ./fenicsx python3 benchmarks/misuses.py
    ./fenicsx python3 benchmarks/misuses.py --all scene
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import select
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from misuse import BAD, GOOD, Misuse, Outcome, outcome  # noqa: E402
from misused_groups import GROUPS  # noqa: E402

# Seconds that a misuse may take, and memory of a process (bytes).
LONGEST, MEMORY = 10.0, 6 << 30
# What misuses write goes with this process.
HOME = tempfile.TemporaryDirectory(prefix="misuses-")


def outcomes(misuses: Sequence[Misuse]) -> Iterator[Outcome]:
    """What became of each, in processes that are begun anew where one ends or hangs."""
    done = 0
    while done < len(misuses):
        child, pipe = _forked(misuses[done:])
        with open(pipe, "rb", buffering=0) as file:
            while done < len(misuses):
                ready, _, _ = select.select([file], [], [], LONGEST)
                line = file.readline() if ready else None
                if not line:
                    break
                yield Outcome(*json.loads(line))
                done += 1
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if done < len(misuses):
            how = f"its process ended with {os.waitstatus_to_exitcode(status)}"
            yield Outcome("hung", how if line == b"" else f"took more than {LONGEST:g} s")
            done += 1


def _forked(misuses: Sequence[Misuse]) -> tuple[int, int]:
    """A process that makes misuses one by one, and a pipe with a line for each."""
    reading, writing = os.pipe()
    child = os.fork()
    if child:
        os.close(writing)
        return child, reading
    try:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        os.chdir(tempfile.mkdtemp(dir=HOME.name))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        for misuse in misuses:
            os.write(writing, json.dumps(outcome(misuse)).encode() + b"\n")
        signal.pause()  # ended by the one that reads
    finally:
        os._exit(1)


def main() -> int:
    """Run all, print a table of each group and what is not good."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="parts of names of groups or misuses (all)")
    parser.add_argument("--all", action="store_true", help="print what was told of each")
    arguments = parser.parse_args()
    total: dict[str, Counter] = {}
    for group, make in GROUPS.items():
        chosen = [
            misuse for misuse in make()
            if not arguments.names
            or any(name in group or name in misuse.name for name in arguments.names)
        ]  # fmt: skip
        found = total[group] = Counter()
        for misuse, (kind, told) in zip(chosen, outcomes(chosen), strict=True):
            found[kind] += 1
            if arguments.all or kind in BAD:
                print(f"{kind}: {group}: {misuse.name}\n    {told[:400]}", flush=True)
    kinds = (*GOOD, *BAD)
    print("\n| misuses | " + " | ".join(kinds) + " |\n|---|" + "---:|" * len(kinds))
    for group, found in total.items():
        if found:
            print(f"| {group} | " + " | ".join(str(found[kind] or "") for kind in kinds) + " |")
    everything = sum(total.values(), Counter())
    counts = " | ".join(str(everything[kind]) for kind in kinds)
    print(f"| {everything.total()} in all | {counts} |")
    return int(any(everything[kind] for kind in BAD))


if __name__ == "__main__":
    sys.exit(main())
