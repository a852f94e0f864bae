# SPDX-License-Identifier: LGPL-3.0-or-later
"""What makes a contact an impact: the velocity level, with Newton's restitution.

`signorini_coulomb.py` says when a point counts as closed; one that is must end at a speed of at
least -e dU0_N, whether it was closing or opening.
"""

import numpy as np

from xper_fx.cache import njit

# Gap at which a pushing point stays closed, relative to h W_NN r_N of the last step.
_STILL_CLOSED = 1e-3


@njit(inline="always")
def least_speed(gap, speed, step, pushed, restitution):
    """The least normal velocity (m/s) that a point may end a step with; -inf if it is open.

    Args:
        gap: in the middle of the step (m).
        speed: normal velocity at the start (m/s).
        step: h (s).
        pushed: speed that the point's impulse of the last step gives (m/s).
        restitution: Newton's e.
    """
    if gap <= _STILL_CLOSED * step * pushed:
        return -restitution * speed
    return -np.inf
