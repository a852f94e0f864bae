# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search of contacts: which bodies may touch, and where they do."""
