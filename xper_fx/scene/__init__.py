# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is simulated: bodies, materials, laws, walls, contacts, ties and loads, checked together."""
