# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks agree on, by all to all and as MPI reduces."""

import json
from unittest.mock import patch

import numpy as np
from mpi4py import MPI

from xper_fx.support import ranks

team, found = ranks.Ranks(MPI.COMM_WORLD), []
values = np.random.default_rng(team.rank).normal(size=(3, 2))
holed = np.where(team.rank == 1, np.nan, values)
for few in (64, 1):
    with patch.object(ranks, "_FEW", few):
        found.append([
            team.sum(values).tolist(), team.max(values).tolist(), team.max(holed).tolist(),
            team.sum(team.rank), team.max(team.rank), team.all(True), team.all(team.rank != 1),
            *team.sum_and_max(2.0 * team.rank, 3.0 - team.rank),
        ])  # fmt: skip
told = team.comm.allgather(repr(found))
if team.rank == 0:
    print(json.dumps({"found": found, "alike": len(set(told)) == 1}))
