# SPDX-License-Identifier: LGPL-3.0-or-later
"""NonSmooth Contact Dynamics: interaction points, laws and solvers, on NumPy and Numba alone."""
