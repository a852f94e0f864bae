# SPDX-License-Identifier: LGPL-3.0-or-later
"""The time loop, and what joins bulk and interactions within one step."""
