# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh vertices whose cells move as one until initially rigid bonds between them let go.

vertex_graphs           the cells that meet at a vertex, and the bonds between them
holding                 whether some admissible tractions hold a vertex together
fused_points            which vertices are whole, and the points of those that are not
growing                 groups of points that take in and give up points
vertex_kernels          clusters of cells at a vertex, and their motion
bonds_of_laws           its bonds, law by law
whole_vertices          vertices that are whole
split_vertices          vertices that are not
turning_vertices        what they do at finite strain
splitting_vertices      the solver beside an explicit bulk
strength_of_vertices    what whole vertices bear, for `bulk/breaking_vertices.py`
"""
