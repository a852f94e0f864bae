# SPDX-License-Identifier: LGPL-3.0-or-later
"""One scene on several ranks: bodies are divided, points at the cuts exchange velocities."""
