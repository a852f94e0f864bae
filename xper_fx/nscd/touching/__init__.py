# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of an explicit bulk, and the vertices that they touch, which take turns.

corners             the cells that meet at a vertex
loose_vertices      vertices whose cells move each by itself
in_turns            what solves a step
touching_clusters   contacts and vertices of one rank
shared_clusters     those that ranks share
"""
