# SPDX-License-Identifier: LGPL-3.0-or-later
"""What every room may use: errors, checks, ranks, threads, profile, versions of DOLFINx."""
