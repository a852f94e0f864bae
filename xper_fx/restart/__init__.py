# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that stop and go on: checkpoints, the scene they belong to, signals."""
