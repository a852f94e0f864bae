# SPDX-License-Identifier: LGPL-3.0-or-later
"""`python3 -m xper_fx.cache`: what kernels are kept, and how to clear them."""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser
from collections import defaultdict

from xper_fx.cache.folder import MAX_BYTES, CacheFolder, folder_path


def main(arguments: list[str] | None = None) -> str:
    """What the command says.

    Args:
        arguments: of the command line; those of this process if not given.
    """
    parser = ArgumentParser(
        prog="python3 -m xper_fx.cache",
        description="Show the compiled kernels that are kept between runs.",
        epilog="XPER_FX_CACHE names another folder, or off: nothing is kept.",
    )
    parser.add_argument("--clear", action="store_true", help="remove them all")
    options = parser.parse_args(arguments)
    path = folder_path()
    if path is None:
        return "XPER_FX_CACHE is off: no kernel is kept."
    try:
        folder = CacheFolder(path)
    except OSError as error:
        parser.exit(1, f"No kernel is kept: {error}.\n")
    files = list(folder.files())
    total = sum(file.size for file in files)
    said = f"{len(files)} kernels, {total / 1e6:.1f} of at most {MAX_BYTES / 1e6:.0f} MB, in {path}"
    if options.clear:
        left = folder.trim(0)
        return f"{said}: " + ("removed" if left == 0 else f"{left / 1e6:.1f} MB cannot be removed")
    kernels = defaultdict(list)
    for file in files:
        kernels[file.title].append(file)
    lines = [said, f"{'files':>7}{'MB':>8}{'last used':>18}  kernel"] if files else [said]
    for title, same in sorted(kernels.items(), key=lambda item: -sum(f.size for f in item[1])):
        used = time.strftime("%Y-%m-%d %H:%M", time.localtime(max(f.used for f in same)))
        lines.append(f"{len(same):7}{sum(f.size for f in same) / 1e6:8.2f}{used:>18}  {title}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(main() + "\n")
