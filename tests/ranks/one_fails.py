# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors on all ranks, which they catch; then one on the last, in a stage that is asked for.

The second of those that are caught is the first rank's as it writes rows of all.
"""

import sys
from contextlib import suppress
from pathlib import Path
from unittest.mock import patch

import few_bodies
import numpy as np
from mpi4py import MPI

from xper_fx.bulk.bulk import Bulk
from xper_fx.output import row_blocks
from xper_fx.output.field_series import FieldSeries
from xper_fx.output.hdf5_tree import write_tree
from xper_fx.output.recorder import Recorder
from xper_fx.parallel import shared_points
from xper_fx.simulation.simulation import Simulation
from xper_fx.support import ranks
from xper_fx.support.saved_rows import Rows

stage, folder, comm = sys.argv[1], Path(sys.argv[2]), MPI.COMM_WORLD
scene, options, _ = few_bodies.tied()


def fail(*_, **__):
    """Run out of memory."""
    raise MemoryError("by hand")


with suppress(MemoryError), patch.object(shared_points, "facet_points", fail):
    Simulation(scene, **options)
    print("gone on")
rows = {name: Rows(np.arange(3) + 3 * comm.rank, np.ones(3)) for name in "ab"}
with suppress(MemoryError), patch.object(row_blocks, "_joined", fail):
    write_tree(folder / "one_fails.h5", rows, ranks.Ranks(comm))
    print("gone on")
print("all have caught it", flush=True)
first = Simulation(scene, **options)
saved = first.saved_in_order()
comm.barrier()
places = {
    "set-up": (shared_points, "facet_points"),
    "restart": (Bulk, "restore"),
    "record": (FieldSeries, "write"),
}
with patch.object(ranks, "_PATIENCE", 1.0):
    if comm.rank == 1 and stage in places:
        patch.object(*places[stage], fail).start()
    if stage == "set-up":
        Simulation(scene, **options)
    elif stage == "restart":
        first.restore(saved)
    else:
        with Recorder(first, folder, end_time=4e-3) as recorder:
            for record in first.steps(4e-3):
                recorder.record(record)
                if comm.rank == 1 and stage == "script":
                    sys.exit("left by hand")
    comm.barrier()
print("gone on", flush=True)
