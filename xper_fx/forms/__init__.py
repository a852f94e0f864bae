# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL: kinematics, the weak form of the bulk, and its loads. Knows nothing of contact."""
