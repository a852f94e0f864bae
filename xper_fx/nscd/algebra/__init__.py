# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small vectors and matrices of kernels, by dimension; Krylov methods and mixing of large ones."""
