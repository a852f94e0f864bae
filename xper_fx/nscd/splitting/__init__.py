# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh vertices whose cells move as one until initially rigid bonds between them let go.

    vertex_graphs   the cells that meet at a vertex, and the bonds between them
    holding         whether some admissible tractions hold a vertex together
    growing         points that come about where a vertex has cracked
    fused_points    which vertices are whole, and what wakes them
    splitting_vertices  the solver
"""
